unit_test(filter test_filter)
