unit_test(plan test_plan)
unit_test(plan test_budget)
unit_test(plan test_buy m)
