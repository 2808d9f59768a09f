# SPDX-License-Identifier: Apache-2.0
# The few build functions of the project. One library a folder, explicit sources, no global flags.

# Language level, warnings and sanitizers for everything of ours. Warnings of Debian's GCC 12 are errors; later ones warn of
# more, in the headers of others too, and Clang's are for tests/check_tidy. Products and sums are rounded apart: where the
# compiler may fuse them (aarch64, -march=native) the same episode would have other bytes.
add_library(etude_options INTERFACE)
target_compile_features(etude_options INTERFACE cxx_std_20)
target_include_directories(etude_options INTERFACE ${CMAKE_SOURCE_DIR})
target_compile_options(etude_options INTERFACE
  $<$<COMPILE_LANGUAGE:CXX>:-Wall -Wextra -Wno-missing-field-initializers -ffp-contract=off>
  $<$<AND:$<COMPILE_LANG_AND_ID:CXX,GNU>,$<VERSION_LESS:$<CXX_COMPILER_VERSION>,13>>:-Werror>)
# GCC collects its garbage from 1 GiB on (it begins at 128 MiB): 5 % less time for a file.
target_compile_options(etude_options INTERFACE
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:--param=ggc-min-heapsize=1048576>)
# Sources compiled several as one (CMAKE_UNITY_BUILD) look like headers to this warning.
if(CMAKE_UNITY_BUILD)
  target_compile_options(etude_options INTERFACE
    $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<CXX_COMPILER_ID:GNU>>:-Wno-subobject-linkage>)
endif()
target_compile_definitions(etude_options INTERFACE
  ETUDE_VERSION="${PROJECT_VERSION}" SPDLOG_COMPILED_LIB SPDLOG_FMT_EXTERNAL)
if(ETUDE_SANITIZE)
  # gcc 12 takes std::regex for uninitialized once it is instrumented (PR 105562)
  target_compile_options(etude_options INTERFACE -fsanitize=${ETUDE_SANITIZE} -fno-omit-frame-pointer
    $<$<CXX_COMPILER_ID:GNU>:-Wno-maybe-uninitialized>)
  target_link_options(etude_options INTERFACE -fsanitize=${ETUDE_SANITIZE})
endif()
# What is tested is optimized, but for inline functions and templates of headers, of which the linker may take a test's copy;
# tests are not: half of the time of compiling them would go into that.
set(ETUDE_TEST_OPTIONS $<$<CONFIG:Release>:-O0>)
if(ETUDE_SANITIZE MATCHES "address")
  set(ETUDE_TEST_OPTIONS -O0)
endif()

# The headers of others that most sources include take longer to parse than the sources take to compile, so they are
# precompiled once, and once more with GoogleTest for tests. Sources still include what they use: ETUDE_PCH=OFF
# builds without.
option(ETUDE_PCH "Precompile the headers of others that most sources include" ON)
set(CMAKE_PCH_WARN_INVALID OFF)
function(etude_add_precompiled_headers name)
  cmake_parse_arguments(arg "" "" "LIBS;HEADERS" ${ARGN})
  file(CONFIGURE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/${name}.cc CONTENT "// nothing but the headers\n")
  add_library(${name} STATIC ${CMAKE_CURRENT_BINARY_DIR}/${name}.cc)
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS})
  target_precompile_headers(${name} PRIVATE ${arg_HEADERS})
endfunction()
if(ETUDE_PCH)
  set(ETUDE_COMMON_HEADERS <algorithm> <array> <chrono> <cmath> <cstdint> <filesystem> <functional> <map> <memory> <mutex>
      <numbers> <optional> <set> <span> <string> <thread> <utility> <vector>
      <Eigen/Core> <Eigen/Geometry> <fmt/format.h> <fmt/ranges.h> <nlohmann/json.hpp> <tl/expected.hpp>)
  set(ETUDE_COMMON_LIBRARIES fmt::fmt spdlog::spdlog nlohmann_json::nlohmann_json Threads::Threads Eigen3::Eigen)
  # every source is compiled with the flags that the headers were
  target_link_libraries(etude_options INTERFACE ${ETUDE_COMMON_LIBRARIES})
  etude_add_precompiled_headers(etude_pch HEADERS ${ETUDE_COMMON_HEADERS})
  if(ETUDE_DEV)
    etude_add_precompiled_headers(etude_test_pch LIBS GTest::gmock
                                  HEADERS ${ETUDE_COMMON_HEADERS} <gmock/gmock.h> <gtest/gtest.h>)
    target_compile_options(etude_test_pch PRIVATE ${ETUDE_TEST_OPTIONS})
  endif()
endif()
function(etude_use_precompiled_headers target headers)
  if(ETUDE_PCH)
    target_precompile_headers(${target} REUSE_FROM ${headers})
  endif()
endfunction()

# etude_add_library(NAME SRCS a.cc b.cc PUBLIC dep... PRIVATE dep... [OWN_PCH])
# makes target etude_NAME with alias etude::NAME. OWN_PCH: it has precompiled headers of its own.
function(etude_add_library name)
  cmake_parse_arguments(arg "OWN_PCH" "" "SRCS;PUBLIC;PRIVATE" ${ARGN})
  add_library(etude_${name} STATIC ${arg_SRCS})
  add_library(etude::${name} ALIAS etude_${name})
  target_link_libraries(etude_${name} PUBLIC etude_options ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
  set_target_properties(etude_${name} PROPERTIES ETUDE_OWN_PCH ${arg_OWN_PCH})
  if(NOT arg_OWN_PCH)
    etude_use_precompiled_headers(etude_${name} etude_pch)
  endif()
endfunction()

# etude_add_program(NAME SRCS main.cc LIBS dep...) makes build/bin/NAME.
function(etude_add_program name)
  cmake_parse_arguments(arg "" "" "SRCS;LIBS" ${ARGN})
  add_executable(${name} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS})
  etude_use_precompiled_headers(${name} etude_pch)
endfunction()

# Test programs are many and large: the gold linker takes a fifth of the time.
include(CheckLinkerFlag)
check_linker_flag(CXX -fuse-ld=gold ETUDE_LINKER_GOLD)

# etude_add_test(NAME SRCS a_test.cc LIBS dep... [LABEL unit] [TIMEOUT 240] [WAITS])
# makes one GoogleTest program, one ctest entry. Labels: unit, contract, integration. WAITS: it waits for most of its time, for
# leases, discovery or processes, and can be run beside what computes. The files of a program are compiled
# as one (CMAKE_UNITY_BUILD), so each has a namespace of its own, named after it, for its fixtures and helpers.
function(etude_add_test name)
  cmake_parse_arguments(arg "WAITS" "LABEL;TIMEOUT" "SRCS;LIBS" ${ARGN})
  if(NOT arg_LABEL)
    set(arg_LABEL unit)
  endif()
  if(arg_WAITS)
    list(APPEND arg_LABEL waits)
  endif()
  if(NOT arg_TIMEOUT)
    set(arg_TIMEOUT 240)
  endif()
  if(ETUDE_SANITIZE)
    math(EXPR arg_TIMEOUT "4 * ${arg_TIMEOUT}")  # all takes several times as long
  endif()
  # Of an inline function the linker keeps the first copy that it meets: what is tested comes first, since that is
  # optimized, or it would run as the test's files are compiled.
  set(tested "")
  foreach(library IN LISTS arg_LIBS)
    string(REPLACE "::" "_" library ${library})
    if(TARGET ${library})
      get_target_property(type ${library} TYPE)
      get_target_property(folder ${library} SOURCE_DIR)
      get_target_property(own_headers ${library} ETUDE_OWN_PCH)
      if(type STREQUAL "STATIC_LIBRARY" AND NOT own_headers AND NOT folder MATCHES "^${CMAKE_SOURCE_DIR}/tests")
        list(APPEND tested $<TARGET_OBJECTS:${library}>)
      endif()
    endif()
  endforeach()
  add_executable(${name} ${tested} ${arg_SRCS})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS} GTest::gmock GTest::gtest_main)
  target_link_options(${name} PRIVATE $<$<BOOL:${ETUDE_LINKER_GOLD}>:-fuse-ld=gold>)
  etude_use_precompiled_headers(${name} etude_test_pch)
  target_compile_options(${name} PRIVATE ${ETUDE_TEST_OPTIONS})
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/tests)
  add_test(NAME ${name} COMMAND ${name} WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
  set_tests_properties(${name} PROPERTIES LABELS "${arg_LABEL}" TIMEOUT ${arg_TIMEOUT}
    ENVIRONMENT "ETUDE_BIN=${CMAKE_BINARY_DIR}/bin")
endfunction()

# etude_add_bench(NAME SRCS a_bench.cc LIBS dep...) makes build/bench/NAME, built and run by `tests/run bench`.
if(NOT TARGET benches)
  add_custom_target(benches)
endif()
function(etude_add_bench name)
  cmake_parse_arguments(arg "" "" "SRCS;LIBS" ${ARGN})
  add_executable(${name} EXCLUDE_FROM_ALL ${arg_SRCS})
  add_dependencies(benches ${name})
  target_link_libraries(${name} PRIVATE etude_options ${arg_LIBS})
  etude_use_precompiled_headers(${name} etude_pch)
  set_target_properties(${name} PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}/bench)
endfunction()
