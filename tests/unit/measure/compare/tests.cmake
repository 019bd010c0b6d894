unit_test(compare test_metrics OpenMP::OpenMP_C)
unit_test(compare test_flip OpenMP::OpenMP_C)
