unit_test(base test_rng)
unit_test(base test_options)
unit_test(base test_base)
unit_test(base test_file_store)
