unit_test(radiance test_components compare source)
