# b4mrl_room_sources(OUT folder...): all .cc files of these folders, their subfolders excluded. What
# stands in a room is built, so that a new file needs no line in a CMakeLists.txt; a file that is
# added or removed configures the build anew.
function(b4mrl_room_sources out)
  set(sources)
  foreach(folder ${ARGN})
    file(GLOB found CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/${folder}/*.cc)
    if(NOT found)
      message(FATAL_ERROR "${CMAKE_CURRENT_SOURCE_DIR}/${folder} holds no sources")
    endif()
    list(APPEND sources ${found})
  endforeach()
  set(${out} ${sources} PARENT_SCOPE)
endfunction()
