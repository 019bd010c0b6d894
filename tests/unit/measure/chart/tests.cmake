unit_test(chart test_judge OpenMP::OpenMP_C)
unit_test(chart test_lists)
unit_test(chart test_truth)
unit_test(chart test_order)
