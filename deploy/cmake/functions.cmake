# SPDX-License-Identifier: Apache-2.0
# The few build functions of the project. One library a folder, explicit sources, no global flags.

# Language level, warnings and sanitizers for everything of ours.
add_library(etude_options INTERFACE)
target_compile_features(etude_options INTERFACE cxx_std_20)
target_include_directories(etude_options INTERFACE ${CMAKE_SOURCE_DIR})
target_compile_options(etude_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Werror -Wno-missing-field-initializers>)
target_compile_definitions(etude_options INTERFACE
  ETUDE_VERSION="${PROJECT_VERSION}" SPDLOG_COMPILED_LIB SPDLOG_FMT_EXTERNAL)
if(ETUDE_SANITIZE)
  target_compile_options(etude_options INTERFACE -fsanitize=${ETUDE_SANITIZE} -fno-omit-frame-pointer)
  target_link_options(etude_options INTERFACE -fsanitize=${ETUDE_SANITIZE})
endif()

# etude_add_library(NAME SRCS a.cc b.cc PUBLIC dep... PRIVATE dep...)
# makes target etude_NAME with alias etude::NAME.
function(etude_add_library name)
  cmake_parse_arguments(arg "" "" "SRCS;PUBLIC;PRIVATE" ${ARGN})
  add_library(etude_${name} STATIC ${arg_SRCS})
  add_library(etude::${name} ALIAS etude_${name})
  target_link_libraries(etude_${name} PUBLIC etude_options ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
endfunction()

# etude_add_program(NAME SRCS main.cc LIBS dep...) makes build/bin/NAME.
function(etude_add_program name)
  cmake_parse_arguments(arg "" "" "SRCS;LIBS" ${ARGN})
  add_executable(${name} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS})
endfunction()

# etude_add_test(NAME SRCS a_test.cc LIBS dep... [LABEL unit] [TIMEOUT 60])
# makes one GoogleTest program, one ctest entry. Labels: unit, contract, integration.
function(etude_add_test name)
  cmake_parse_arguments(arg "" "LABEL;TIMEOUT" "SRCS;LIBS" ${ARGN})
  if(NOT arg_LABEL)
    set(arg_LABEL unit)
  endif()
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 120)
  endif()
  add_executable(${name} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS} GTest::gmock GTest::gtest_main)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  add_test(NAME ${name} COMMAND ${name} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
  set_tests_properties(${name} PROPERTIES LABELS ${arg_LABEL} TIMEOUT ${arg_TIMEOUT}
    ENVIRONMENT "ETUDE_BIN=${CMAKE_BINARY_DIR}/bin")
endfunction()

# etude_add_bench(NAME SRCS a_bench.cc LIBS dep...) makes build/bench/NAME, run by `tests/run bench`.
function(etude_add_bench name)
  cmake_parse_arguments(arg "" "" "SRCS;LIBS" ${ARGN})
  add_executable(${name} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bench)
endfunction()
