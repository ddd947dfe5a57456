# b4mrl_room_sources(OUT folder... [APART folder...]): all .cc files of these folders, their subfolders
# excluded. What stands in a room is built, so that a new file needs no line in a CMakeLists.txt; a file
# that is added or removed configures the build anew. With B4MRL_WHOLE_ROOMS the files of a room are
# compiled as one, but for those of rooms behind APART.
function(b4mrl_room_sources out)
  cmake_parse_arguments(ARG "" "" "APART" ${ARGN})
  set(sources)
  foreach(folder ${ARG_UNPARSED_ARGUMENTS} ${ARG_APART})
    file(GLOB found CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${folder}/*.cc)
    if(NOT found)
      message(FATAL_ERROR "${CMAKE_CURRENT_SOURCE_DIR}/${folder} holds no sources")
    endif()
    if(NOT folder IN_LIST ARG_APART)
      set_source_files_properties(${found} PROPERTIES UNITY_GROUP ${folder})
    endif()
    list(APPEND sources ${found})
  endforeach()
  set(${out} ${sources} PARENT_SCOPE)
endfunction()

# b4mrl_compile_rooms_whole(folder...): compiles the files of a room as one in the targets of these folders
# and of their subfolders. CMake itself leaves out files with compiler options of their own.
function(b4mrl_compile_rooms_whole)
  foreach(folder ${ARGN})
    get_property(targets DIRECTORY ${folder} PROPERTY BUILDSYSTEM_TARGETS)
    foreach(target ${targets})
      set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
    endforeach()
    get_property(inner DIRECTORY ${folder} PROPERTY SUBDIRECTORIES)
    b4mrl_compile_rooms_whole(${inner})
  endforeach()
endfunction()
