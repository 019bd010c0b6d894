unit_test(between test_taken)
