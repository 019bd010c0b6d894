unit_test(cache test_cache_file)
unit_test(cache test_cache_folder)
