add_executable(misbehaving_decoder import/decoder/misbehave.c)
target_link_libraries(misbehaving_decoder PRIVATE flags decoder m)
unit_test(decoder test_decoder)
target_compile_definitions(test_decoder_test_decoder PRIVATE MISBEHAVE="$<TARGET_FILE:misbehaving_decoder>"
                                                             CORPUS="${CMAKE_SOURCE_DIR}/tests/fuzz/corpus")
add_dependencies(test_decoder_test_decoder misbehaving_decoder relight-decoder)
if(RELIGHT_VIDEO) # texels.c is part of relight-video alone
  unit_test(decoder test_texels PkgConfig::AVCODEC)
  target_sources(test_decoder_test_texels PRIVATE ${CMAKE_SOURCE_DIR}/server/import/decoder/texels.c)
  unit_test(decoder test_video PkgConfig::AVCODEC PkgConfig::TURBOJPEG)
  add_dependencies(test_decoder_test_video relight-video)
endif()
