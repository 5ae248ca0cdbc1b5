# Every target of the project goes through these, so that warnings and include paths are set once.
add_library(weft_flags INTERFACE)
target_include_directories(weft_flags INTERFACE ${PROJECT_SOURCE_DIR}/lib)
target_compile_options(weft_flags INTERFACE -Wall -Wextra -Wshadow)
if(WEFT_WERROR)
  target_compile_options(weft_flags INTERFACE -Werror)
endif()

# weft_library(NAME SOURCES ... DEPENDS ...): the static library weft_NAME
function(weft_library NAME)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS;PRIVATE_DEPENDS" ${ARGN})
  add_library(weft_${NAME} STATIC ${ARG_SOURCES})
  target_link_libraries(weft_${NAME} PUBLIC weft_flags ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE_DEPENDS})
  set_property(GLOBAL APPEND PROPERTY WEFT_LIBRARIES weft_${NAME})
endfunction()

# weft_process(NAME SOURCES ... DEPENDS ...): the library weft_NAME_stage with the stage and the executable
# weft-NAME with main.cpp. The stages' library also runs inside the weft command, several in one process.
function(weft_process NAME)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_library(weft_${NAME}_stage STATIC ${ARG_SOURCES})
  target_include_directories(weft_${NAME}_stage PUBLIC ${PROJECT_SOURCE_DIR})
  target_link_libraries(weft_${NAME}_stage PUBLIC weft_flags weft_stage ${ARG_DEPENDS})
  set_property(GLOBAL APPEND PROPERTY WEFT_LIBRARIES weft_${NAME}_stage)
  add_executable(weft-${NAME} main.cpp)
  target_link_libraries(weft-${NAME} PRIVATE weft_${NAME}_stage)
  set_property(GLOBAL APPEND PROPERTY WEFT_PROCESSES weft-${NAME})
endfunction()

# weft_test(NAME SOURCES ... DEPENDS ... [LABEL slow]): one GoogleTest executable NAME_test, each test known to ctest.
# `slow`: minutes each, only run by `./weft test --slow`.
function(weft_test NAME)
  cmake_parse_arguments(ARG "" "LABEL" "SOURCES;DEPENDS" ${ARGN})
  set(LIMITS TIMEOUT 300)
  if(ARG_LABEL)
    set(LIMITS TIMEOUT 3600 LABELS ${ARG_LABEL})
  endif()
  add_executable(${NAME}_test ${ARG_SOURCES})
  target_include_directories(${NAME}_test PRIVATE ${PROJECT_SOURCE_DIR} ${PROJECT_SOURCE_DIR}/tests)
  target_link_libraries(${NAME}_test PRIVATE weft_flags ${ARG_DEPENDS} GTest::gtest_main)
  target_compile_definitions(${NAME}_test PRIVATE WEFT_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
                                                  WEFT_BINARY_DIR="${PROJECT_BINARY_DIR}")
  gtest_discover_tests(${NAME}_test TEST_PREFIX ${NAME}/ DISCOVERY_TIMEOUT 60
                       PROPERTIES ${LIMITS})
endfunction()
include(GoogleTest)
