unit_test(cache test_cache_file)
