unit_test(cache_indirect test_indirect_file frame z)
unit_test(cache_indirect test_indirect OpenMP::OpenMP_C)
unit_test(cache_indirect test_indirect_parts)
unit_test(cache_indirect test_indirect_series)
