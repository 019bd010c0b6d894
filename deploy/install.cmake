# Run by `cmake --install` after CMake's own steps: installs files that depend on the prefix. For /usr the configuration is in /etc; for
# any other prefix in that prefix's etc. CPack installs into a temporary folder that ends in /usr; that folder must not appear inside
# installed files.
#   source, build: the trees;  CMAKE_INSTALL_PREFIX as given
if(CMAKE_INSTALL_PREFIX MATCHES "^(.*)/usr/*$")
  set(etc "${CMAKE_MATCH_1}/etc")
  set(BIN /usr/bin)
  set(ETC /etc)
else()
  set(etc "${CMAKE_INSTALL_PREFIX}/etc")
  set(BIN "${CMAKE_INSTALL_PREFIX}/bin")
  set(ETC "${etc}")
endif()
configure_file(${source}/deploy/relightd.service ${build}/deploy/relightd.service @ONLY)
file(INSTALL ${build}/deploy/relightd.service DESTINATION "${CMAKE_INSTALL_PREFIX}/lib/systemd/system")
file(INSTALL ${source}/deploy/relightd.json DESTINATION "${etc}/relightd")
