add_library(test_env_make_exr STATIC env/make_exr.c)
target_include_directories(test_env_make_exr PUBLIC env)
target_link_libraries(test_env_make_exr PUBLIC PkgConfig::OPENEXR ${EXRCORE_LIBRARY} PRIVATE flags)

unit_test(env test_decode_exr test_env_make_exr)
