unit_test(between test_taken)
unit_test(between test_deflicker m)
