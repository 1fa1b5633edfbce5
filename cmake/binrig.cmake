include(GoogleTest OPTIONAL)

# binrig_library(NAME [LINK target...] [PRIVATE target...] [FOLDERS folder...] [EXCLUDE file...]): every .cpp of this
# folder and of the named ones below it as the static library binrig_NAME.
function(binrig_library name)
  cmake_parse_arguments(ARG "" "" "LINK;PRIVATE;FOLDERS;EXCLUDE" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
  foreach(folder IN LISTS ARG_FOLDERS)
    file(GLOB more CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${folder}/*.cpp)
    list(APPEND sources ${more})
  endforeach()
  foreach(file IN LISTS ARG_EXCLUDE)
    list(REMOVE_ITEM sources ${CMAKE_CURRENT_SOURCE_DIR}/${file})
  endforeach()
  if(NOT sources)
    add_library(binrig_${name} INTERFACE)
    target_link_libraries(binrig_${name} INTERFACE ${ARG_LINK})
    return()
  endif()
  add_library(binrig_${name} STATIC ${sources})
  target_link_libraries(binrig_${name} PUBLIC ${ARG_LINK} PRIVATE ${ARG_PRIVATE})
  binrig_precompile(binrig_${name})
  binrig_compile_together(binrig_${name})
endfunction()

# With BINRIG_UNITY, the compiler reads six files at once: a clean build instantiates templates that several files need
# once. Names of anonymous namespaces must then differ within a folder.
function(binrig_compile_together target)
  if(BINRIG_UNITY)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 6)
  endif()
endfunction()

# The headers that nearly every file reads; one precompiled header serves all targets.
function(binrig_precompile target)
  if(NOT BINRIG_PCH)
    return()
  endif()
  if(target STREQUAL "binrig_core")
    target_precompile_headers(${target} PRIVATE
      <algorithm> <array> <cmath> <cstdint> <functional> <map> <memory> <optional> <string> <vector>
      <Eigen/Core> <Eigen/Geometry> <opencv2/core.hpp>)
  else()
    target_precompile_headers(${target} REUSE_FROM binrig_core)
  endif()
endfunction()

# binrig_tests(NAME [TOGETHER] [LINK target...]): every *_test.cpp of tests/NAME as one program, each test known to
# ctest; TOGETHER: the program is one test, where starting it takes longer than a test of it.
function(binrig_tests name)
  cmake_parse_arguments(ARG "TOGETHER" "" "LINK" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/tests/${name}/*.cpp)
  if(NOT sources)
    return()
  endif()
  add_executable(${name}_tests ${sources})
  target_link_libraries(${name}_tests PRIVATE ${ARG_LINK} binrig_test_support GTest::gtest_main GTest::gmock)
  binrig_precompile(${name}_tests)
  if(ARG_TOGETHER)
    add_test(NAME ${name}_tests COMMAND ${name}_tests WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
    set_tests_properties(${name}_tests PROPERTIES TIMEOUT 300)
    return()
  endif()
  binrig_compile_together(${name}_tests)
  gtest_discover_tests(${name}_tests DISCOVERY_MODE PRE_TEST DISCOVERY_TIMEOUT 60 PROPERTIES TIMEOUT 300
    WORKING_DIRECTORY ${CMAKE_SOURCE_DIR})
endfunction()
