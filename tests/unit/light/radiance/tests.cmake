unit_test(radiance test_components compare source)
unit_test(radiance test_parts)
