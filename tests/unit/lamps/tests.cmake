unit_test(lamps test_lamps light OpenMP::OpenMP_C)
unit_test(lamps test_lamps_paths light OpenMP::OpenMP_C)
unit_test(lamps test_lamps_filtered light OpenMP::OpenMP_C)
