# Language level, warnings and sanitizers for every target of the project.
set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY ${PROJECT_BINARY_DIR})
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
# NDEBUG is never set: an invariant that is worth writing down is worth checking in release too.
set(CMAKE_CXX_FLAGS_RELEASE "-O2 -g1")
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g")
set(CMAKE_CXX_FLAGS_MINSIZEREL "-Os -g1")
set(CMAKE_CXX_FLAGS_DEBUG "-O1 -g")

# Another project's compiler may warn of what ours does not.
option(B4MRL_WERROR "Treat warnings as errors" ${PROJECT_IS_TOP_LEVEL})
set(B4MRL_SANITIZE "" CACHE STRING "Sanitizers to build with, as for -fsanitize=")
option(B4MRL_COVERAGE "Count the executed lines, for gcov" OFF)
# algorithms/ alone is built for one processor type; everything else stays baseline x86-64, so that
# simulation, corruption and file bytes do not depend on the machine that compiled them.
set(B4MRL_ARCH "native" CACHE STRING "-march= for algorithms/ (learners); use x86-64-v3 on clusters")
# How B4MRL_ARCH is shown: "native" says which processor that was.
set(B4MRL_ARCHITECTURE ${B4MRL_ARCH})
if(B4MRL_ARCH STREQUAL "native")
  execute_process(COMMAND ${CMAKE_CXX_COMPILER} -march=native -Q --help=target
                  OUTPUT_VARIABLE target ERROR_QUIET)
  if(target MATCHES "-march=[ \t]+([a-z0-9-]+)")
    set(B4MRL_ARCHITECTURE "native (${CMAKE_MATCH_1})")
  endif()
endif()

add_compile_options(-Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Wno-missing-field-initializers)
# Contraction would make a*b+c depend on whether the processor has FMA.
add_compile_options(-ffp-contract=off)
if(B4MRL_WERROR)
  add_compile_options(-Werror)
endif()
if(B4MRL_SANITIZE)
  # GCC 12 warns falsely inside libstdc++'s regex when it instruments it.
  add_compile_options(-Wno-maybe-uninitialized)
  add_compile_options(-fsanitize=${B4MRL_SANITIZE} -fno-omit-frame-pointer
                      -fno-sanitize-recover=all)
  if(B4MRL_SANITIZE MATCHES "thread")
    # ThreadSanitizer does not understand fences. Those of proto/wire/door.cc order the words by
    # which two sides fall asleep and wake each other; no other data depend on them.
    add_compile_options(-Wno-tsan)
  endif()
  add_link_options(-fsanitize=${B4MRL_SANITIZE})
  if(B4MRL_SANITIZE MATCHES "address" AND CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    # As shared libraries, GCC's two runtimes share the function that sets the file of reports but not the file:
    # what UndefinedBehaviorSanitizer finds would not get there. Linked into the program they are one.
    add_link_options(-static-libasan -static-libubsan)
  endif()
endif()
if(B4MRL_COVERAGE)
  # Threads of one process share the counters.
  add_compile_options(--coverage -fprofile-update=atomic)
  add_link_options(--coverage)
endif()

# Most of a compilation is reading headers, which the files of a room share (CONTRIBUTING.md).
option(B4MRL_WHOLE_ROOMS "Compile the files of a room as one" OFF)

find_program(B4MRL_CCACHE ccache)
if(B4MRL_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${B4MRL_CCACHE})
endif()
