unit_test(scene test_rays)
unit_test(scene test_json)
