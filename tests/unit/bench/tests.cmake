unit_test(bench test_bench)
