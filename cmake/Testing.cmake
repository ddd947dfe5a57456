# b4mrl_test(name SOURCES a_test.cc ... LIBS lib ... [TIMEOUT seconds] [LONG seconds] [ALONGSIDE seconds]
# [WHOLE]):
# a Catch2 binary registered with CTest. Every binary shares one compiled Catch2 main. LONG: the cases
# tagged "[long]" are proofs of minutes, a test of their own with that time limit. ALONGSIDE: may run
# beside another test, since the times that it waits for others are generous, and takes about so many
# seconds; tests that are no Catch2 binaries may, unless they say RUN_SERIAL. WHOLE: its
# files are compiled as one where B4MRL_WHOLE_ROOMS has those of a room compiled so.
#
# Before its first run CTest knows no test's time, so those that may run beside others tell theirs
# (property COST): they begin first, the longest at the head, and no core waits for them at the end.
function(b4mrl_test name)
  cmake_parse_arguments(ARG "WHOLE" "TIMEOUT;LONG;ALONGSIDE" "SOURCES;LIBS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE b4mrl_catch_main ${ARG_LIBS})
  if(ARG_WHOLE)
    set_source_files_properties(${ARG_SOURCES} PROPERTIES UNITY_GROUP ${name})
  elseif(B4MRL_WHOLE_ROOMS)
    b4mrl_precompile_headers(${name})
  endif()
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT})
  if(ARG_ALONGSIDE)
    set_tests_properties(${name} PROPERTIES COST ${ARG_ALONGSIDE})
  else()
    set_tests_properties(${name} PROPERTIES RUN_SERIAL TRUE)
  endif()
  if(ARG_LONG)
    string(REGEX REPLACE "_test$" "_long" long ${name})
    add_test(NAME ${long} COMMAND ${name} "[long]")
    set_tests_properties(${long} PROPERTIES
      TIMEOUT ${ARG_LONG} LABELS "long;release-only" RUN_SERIAL TRUE)
  endif()
endfunction()

# b4mrl_precompile_headers(test): has the compiler read the headers of Catch2 and of other libraries from a
# file that all tests with the same compiler options share; the first of them makes it. Where the files of a
# room are compiled as one, tests need this as well, since most of theirs use the same names and stay apart.
function(b4mrl_precompile_headers test)
  b4mrl_links(learners ${test} b4mrl_algorithms)
  set(headers <catch2/catch.hpp> <filesystem> <fstream> <nlohmann/json.hpp> <fmt/format.h> <proto/b4mrl.pb.h>)
  if(learners)
    list(APPEND headers <Eigen/Core>)
  endif()
  get_property(owner GLOBAL PROPERTY B4MRL_PRECOMPILED_${learners})
  if(owner)
    target_precompile_headers(${test} REUSE_FROM ${owner})
  else()
    target_precompile_headers(${test} PRIVATE ${headers})
    set_property(GLOBAL PROPERTY B4MRL_PRECOMPILED_${learners} ${test})
  endif()
endfunction()

# b4mrl_links(OUT target library): whether the target links the library, through others too.
function(b4mrl_links out target library)
  set(found FALSE)
  if(target STREQUAL library)
    set(found TRUE)
  elseif(TARGET ${target})
    get_target_property(linked ${target} LINK_LIBRARIES)
    get_target_property(passed_on ${target} INTERFACE_LINK_LIBRARIES)
    foreach(next ${linked} ${passed_on})
      if(NOT found AND next MATCHES "^b4mrl_")
        b4mrl_links(found ${next} ${library})
      endif()
    endforeach()
  endif()
  set(${out} ${found} PARENT_SCOPE)
endfunction()

# b4mrl_script_test(name COMMAND word ... TIMEOUT seconds [COST seconds] [LONG]): a program that ends
# with code 77 where something is missing that it needs, such as a package to download; it counts as
# skipped then. COST: about so many seconds. LONG: a proof of minutes, which has the machine to itself.
function(b4mrl_script_test name)
  cmake_parse_arguments(ARG "LONG" "TIMEOUT;COST" "COMMAND" ${ARGN})
  add_test(NAME ${name} COMMAND ${ARG_COMMAND})
  set_tests_properties(${name} PROPERTIES
    SKIP_RETURN_CODE 77 TIMEOUT ${ARG_TIMEOUT} LABELS release-only)
  if(ARG_COST)
    set_tests_properties(${name} PROPERTIES COST ${ARG_COST})
  endif()
  if(ARG_LONG)
    set_tests_properties(${name} PROPERTIES LABELS "long;release-only" RUN_SERIAL TRUE)
  endif()
endfunction()
