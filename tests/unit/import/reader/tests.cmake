add_executable(misbehaving_reader import/reader/misbehave.c)
target_link_libraries(misbehaving_reader PRIVATE flags formats reader PkgConfig::JANSSON)
unit_test(reader test_reader formats)
target_compile_definitions(test_reader_test_reader PRIVATE MISBEHAVE="$<TARGET_FILE:misbehaving_reader>"
                                                           EXAMPLES="${CMAKE_SOURCE_DIR}/docs/examples")
add_dependencies(test_reader_test_reader misbehaving_reader relight-reader)
unit_test(reader test_parcel)
unit_test(reader test_builtin)
