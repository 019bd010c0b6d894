unit_test(denoise test_filter)
