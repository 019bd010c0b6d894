# Files to decode, made in memory; the fuzzers' corpus comes from them too.
add_library(test_env_make STATIC env/make_exr.c env/make_hdr.c)
target_include_directories(test_env_make PUBLIC env)
target_link_libraries(test_env_make PUBLIC PkgConfig::OPENEXR ${EXRCORE_LIBRARY} PRIVATE flags)

unit_test(env test_image)
unit_test(env test_colour)
unit_test(env test_decode_exr test_env_make)
unit_test(env test_decode_bad_exr test_env_make)
unit_test(env test_dwa z PkgConfig::OPENEXR)
unit_test(env test_decode_hdr test_env_make)
unit_test(env test_resample)
unit_test(env test_layout)
unit_test(env test_samples)
