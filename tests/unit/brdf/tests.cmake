unit_test(brdf test_lobes estimators OpenMP::OpenMP_C)
unit_test(brdf test_lobe OpenMP::OpenMP_C)
unit_test(brdf test_lanes OpenMP::OpenMP_C)
