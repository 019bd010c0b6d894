unit_test(inspector test_probe_report settings PkgConfig::JANSSON)
unit_test(inspector test_probe frame)
