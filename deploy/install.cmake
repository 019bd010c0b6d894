# Run by `cmake --install`, after what CMake itself installs: what depends on where it is installed to. Below /usr the
# configuration is in /etc; below any other prefix it is in that prefix's own etc. CPack installs into a folder of its own
# that ends in /usr, and moves it there later: names inside files must not have that folder.
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
