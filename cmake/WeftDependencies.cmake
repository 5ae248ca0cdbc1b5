# Debian 12 packages. PCL's own CMake package drags VTK in; the few modules used here come from pkg-config.
find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_path(SPECTRA_INCLUDE_DIR Spectra/SymEigsShiftSolver.h REQUIRED)
add_library(spectra::spectra INTERFACE IMPORTED)
set_target_properties(spectra::spectra PROPERTIES INTERFACE_INCLUDE_DIRECTORIES ${SPECTRA_INCLUDE_DIR})
find_package(Ceres REQUIRED)
find_package(yaml-cpp REQUIRED)
find_package(ZLIB REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(CLI11 REQUIRED)
find_package(spdlog REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc imgcodecs features2d)
if(WEFT_BUILD_TESTS)
  find_package(GTest REQUIRED)
  find_package(benchmark REQUIRED)
  # Peers in tests and benchmarks: of the normals and FPFH, of the plane extraction.
  pkg_check_modules(PCL_FEATURES REQUIRED IMPORTED_TARGET pcl_features pcl_search)
  pkg_check_modules(PCL_SEGMENTATION REQUIRED IMPORTED_TARGET pcl_segmentation)
  # Peer of the dense SIFT in tests and benchmarks; without it those are skipped by name.
  find_path(VLFEAT_INCLUDE_DIR vl/dsift.h)
  find_library(VLFEAT_LIBRARY vl)
  if(VLFEAT_INCLUDE_DIR AND VLFEAT_LIBRARY)
    add_library(vlfeat::vlfeat UNKNOWN IMPORTED)
    set_target_properties(vlfeat::vlfeat PROPERTIES IMPORTED_LOCATION ${VLFEAT_LIBRARY}
                                                    INTERFACE_INCLUDE_DIRECTORIES ${VLFEAT_INCLUDE_DIR})
  endif()
endif()

# Debian's LCM ships neither a CMake package nor a usable pkg-config file without glib's.
find_path(LCM_INCLUDE_DIR lcm/lcm-cpp.hpp REQUIRED)
find_library(LCM_LIBRARY lcm REQUIRED)
find_program(LCM_GEN lcm-gen REQUIRED)
add_library(lcm::lcm UNKNOWN IMPORTED)
set_target_properties(lcm::lcm PROPERTIES IMPORTED_LOCATION ${LCM_LIBRARY}
                                          INTERFACE_INCLUDE_DIRECTORIES ${LCM_INCLUDE_DIR})

find_path(SVM_INCLUDE_DIR svm.h PATH_SUFFIXES libsvm REQUIRED)
find_library(SVM_LIBRARY svm REQUIRED)
add_library(svm::svm UNKNOWN IMPORTED)
set_target_properties(svm::svm PROPERTIES IMPORTED_LOCATION ${SVM_LIBRARY}
                                          INTERFACE_INCLUDE_DIRECTORIES ${SVM_INCLUDE_DIR})

find_path(LINEAR_INCLUDE_DIR linear.h PATH_SUFFIXES liblinear REQUIRED)
find_library(LINEAR_LIBRARY linear REQUIRED)
add_library(linear::linear UNKNOWN IMPORTED)
set_target_properties(linear::linear PROPERTIES IMPORTED_LOCATION ${LINEAR_LIBRARY}
                                                INTERFACE_INCLUDE_DIRECTORIES ${LINEAR_INCLUDE_DIR})

pkg_check_modules(OPENNI2 REQUIRED IMPORTED_TARGET libopenni2)
pkg_check_modules(PCL_IO REQUIRED IMPORTED_TARGET pcl_io)
