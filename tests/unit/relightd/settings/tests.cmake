unit_test(settings test_settings)
unit_test(settings test_new_setting stream PkgConfig::JANSSON)
