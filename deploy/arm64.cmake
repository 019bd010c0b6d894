# Cross-compiles for Debian's arm64 on amd64: cmake -DCMAKE_TOOLCHAIN_FILE=deploy/arm64.cmake. Needs crossbuild-essential-arm64, the
# libraries of packages.txt with `:arm64` (dpkg --add-architecture arm64), and qemu-user, by which the programs print their manuals.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_CROSSCOMPILING_EMULATOR qemu-aarch64)
set(CPACK_DEBIAN_PACKAGE_ARCHITECTURE arm64)
set(ENV{PKG_CONFIG_LIBDIR} /usr/lib/aarch64-linux-gnu/pkgconfig:/usr/share/pkgconfig)
