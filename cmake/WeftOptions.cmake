option(WEFT_BUILD_TESTS "Build the tests" ON)
option(WEFT_WERROR "Treat warnings as errors" OFF)
option(WEFT_ASSERTIONS "Keep assert() in optimised builds" OFF)
option(WEFT_SANITIZE "Build with address and undefined behaviour sanitizers" OFF)
option(WEFT_LIBFUZZER "Build the fuzz targets for libFuzzer; clang only" OFF)

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bin)
# Release lets the compiler assume what WEFT_ASSERTIONS checks; -O2, since -O3 buys nothing measurable here.
set(CMAKE_CXX_FLAGS_RELEASE "-O2 -DNDEBUG")
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g1")
if(NOT WEFT_ASSERTIONS)
  string(APPEND CMAKE_CXX_FLAGS_RELWITHDEBINFO " -DNDEBUG")
endif()

# Fused multiply-add rounds once instead of twice: outputs would differ between machines.
add_compile_options(-ffp-contract=off)
if(WEFT_SANITIZE)
  # Instrumented code is too much for this warning of g++ 12: it finds faults in std::regex.
  add_compile_options($<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  add_compile_options(-fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)
  add_link_options(-fsanitize=address,undefined)
  # Debian's Ceres and PCL are built without, where Eigen takes memory from malloc as it comes. Under the sanitizer Eigen
  # would shift it, and what one side takes the other could not give back.
  add_compile_definitions(EIGEN_MALLOC_ALREADY_ALIGNED=1)
endif()

if(WEFT_LIBFUZZER)
  add_compile_options(-fsanitize=fuzzer-no-link)
endif()

find_program(WEFT_CCACHE ccache)
if(WEFT_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${WEFT_CCACHE})
endif()
find_program(WEFT_LLD ld.lld)
if(WEFT_LLD)
  add_link_options(-fuse-ld=lld)
endif()
