unit_test(net test_site)
unit_test(net test_tls_self PkgConfig::OPENSSL)
