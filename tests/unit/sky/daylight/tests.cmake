unit_test(daylight test_epw m)
unit_test(daylight test_pattern m)
unit_test(daylight test_measures m)
unit_test(daylight test_matrix_suns)
