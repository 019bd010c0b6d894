unit_test(annual test_points m)
