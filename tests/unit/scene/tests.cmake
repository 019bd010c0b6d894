unit_test(scene test_rays)
unit_test(scene test_json)
unit_test(scene test_gbuffer OpenMP::OpenMP_C)
unit_test(scene test_chain)
