unit_test(surface test_lobes estimators OpenMP::OpenMP_C)
unit_test(surface test_lobe geometry OpenMP::OpenMP_C)
unit_test(surface test_lanes geometry OpenMP::OpenMP_C)
unit_test(surface test_texture geometry)
