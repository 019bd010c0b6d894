unit_test(import test_model)
unit_test(import test_json)
unit_test(import test_gltf PkgConfig::TURBOJPEG)
unit_test(import test_gltf_reader)
