unit_test(access test_site)
unit_test(access test_tls_self PkgConfig::OPENSSL)
unit_test(access test_tls PkgConfig::OPENSSL)
unit_test(access test_figures)
