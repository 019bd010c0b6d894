unit_test(year test_points m)
