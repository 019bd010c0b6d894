unit_test(plan test_plan)
