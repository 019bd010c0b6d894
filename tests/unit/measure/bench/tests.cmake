unit_test(bench test_bench)
unit_test(bench test_allocations test_env_make)
