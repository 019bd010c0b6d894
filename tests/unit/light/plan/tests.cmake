unit_test(plan test_pilot_allot frame)
unit_test(plan test_pilot_measure frame)
unit_test(plan test_budget)
unit_test(plan test_cost_model m)
