unit_test(probe test_probe_report settings PkgConfig::JANSSON)
unit_test(probe test_probe light)
