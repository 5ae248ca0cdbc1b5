# Toolchain of the preset aarch64: everything compiles for robot boards. It takes Debian's cross compiler
# (g++-aarch64-linux-gnu) and the headers of this machine's own packages, which are the same on every architecture;
# libraries it does not need, as the static ones that are built with it are never linked. ./weft test --slow
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_PROJECT_INCLUDE ${CMAKE_CURRENT_LIST_DIR}/aarch64_packages.cmake)
