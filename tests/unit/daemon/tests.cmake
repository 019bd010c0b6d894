unit_test(daemon test_cost m)
unit_test(daemon test_shade PkgConfig::JANSSON m Threads::Threads)
unit_test(daemon test_threads m Threads::Threads)
