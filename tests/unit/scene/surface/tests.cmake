unit_test(surface test_lobes estimators OpenMP::OpenMP_C)
unit_test(surface test_lobe OpenMP::OpenMP_C)
unit_test(surface test_lanes OpenMP::OpenMP_C)
