unit_test(shade test_direct OpenMP::OpenMP_C)
unit_test(shade test_agreement OpenMP::OpenMP_C)
unit_test(shade kernelcheck OpenMP::OpenMP_C)
unit_test(shade test_visibility OpenMP::OpenMP_C)
