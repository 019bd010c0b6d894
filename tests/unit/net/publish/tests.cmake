unit_test(publish test_target)
if(RELIGHT_H264 AND RELIGHT_VIDEO)
  unit_test(publish test_queue Threads::Threads)
endif()
