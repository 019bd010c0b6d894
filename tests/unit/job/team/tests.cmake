unit_test(team test_shares m)
