unit_test(bounce test_bounce_file light z)
unit_test(bounce test_bounce OpenMP::OpenMP_C)
unit_test(bounce test_bounce_parts)
unit_test(bounce test_bounce_series)
