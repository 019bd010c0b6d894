unit_test(resolve test_resolve)
