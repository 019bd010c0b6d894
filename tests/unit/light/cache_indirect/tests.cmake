unit_test(cache_indirect test_bounce_file frame z)
unit_test(cache_indirect test_bounce OpenMP::OpenMP_C)
unit_test(cache_indirect test_bounce_parts)
unit_test(cache_indirect test_bounce_series)
