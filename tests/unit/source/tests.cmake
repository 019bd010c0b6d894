unit_test(source test_files)
unit_test(source test_watch)
unit_test(source test_sky OpenMP::OpenMP_C)
