unit_test(daemon test_cost m)
unit_test(daemon test_shade PkgConfig::JANSSON m Threads::Threads)
target_compile_definitions(test_daemon_test_shade PRIVATE EVENING="${CMAKE_SOURCE_DIR}/docs/examples/evening.json"
                           RING="${CMAKE_SOURCE_DIR}/docs/examples/ring.json")
unit_test(daemon test_threads m Threads::Threads)
