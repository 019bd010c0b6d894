unit_test(inspector test_inspector_report settings PkgConfig::JANSSON)
unit_test(inspector test_inspector frame)
