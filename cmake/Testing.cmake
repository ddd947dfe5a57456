# b4mrl_test(name SOURCES a_test.cc ... LIBS lib ... [TIMEOUT seconds] [LONG seconds] [ALONGSIDE seconds]):
# a Catch2 binary registered with CTest. Every binary shares one compiled Catch2 main. LONG: the cases
# tagged "[long]" are proofs of minutes, a test of their own with that time limit. ALONGSIDE: may run
# beside another test, since the times that it waits for others are generous, and takes about so many
# seconds; tests that are no Catch2 binaries may, unless they say RUN_SERIAL.
#
# Before its first run CTest knows no test's time, so those that may run beside others tell theirs
# (property COST): they begin first, the longest at the head, and no core waits for them at the end.
function(b4mrl_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT;LONG;ALONGSIDE" "SOURCES;LIBS;LABELS" ${ARGN})
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 120)
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE b4mrl_catch_main ${ARG_LIBS})
  target_compile_definitions(${name} PRIVATE
    B4MRL_SOURCE_DIR="${CMAKE_SOURCE_DIR}" B4MRL_BINARY_DIR="${CMAKE_BINARY_DIR}")
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES TIMEOUT ${ARG_TIMEOUT} LABELS "${ARG_LABELS}")
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
