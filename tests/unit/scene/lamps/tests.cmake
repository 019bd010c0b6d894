unit_test(lamps test_lamps frame OpenMP::OpenMP_C)
unit_test(lamps test_lamps_paths frame OpenMP::OpenMP_C)
unit_test(lamps test_lamps_filtered frame OpenMP::OpenMP_C)
