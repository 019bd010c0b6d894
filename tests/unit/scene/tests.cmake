unit_test(scene test_rays)
