unit_test(film test_exposure OpenMP::OpenMP_C)
unit_test(film test_scale OpenMP::OpenMP_C m)
unit_test(film test_tone OpenMP::OpenMP_C)
unit_test(film test_tone_kernel)
