# Writes the source OUT with the commit of the checkout SOURCE, "" where that is none; leaves an equal
# file as it is, so that nothing is compiled again. Run by `cmake -P` at every build.
set(commit "")
if(EXISTS ${SOURCE}/.git)
  file(REAL_PATH ${SOURCE} checkout)
  # Git reads no checkout of another user, such as one that a container mounts, unless it is named safe.
  execute_process(COMMAND git -c safe.directory=${checkout} describe --always --dirty --abbrev=12 --exclude=*
                  WORKING_DIRECTORY ${checkout}
                  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_VARIABLE error RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    set(commit "")
    message(WARNING "Programs and results will name no commit, for git does not tell it: ${result} ${error}")
  endif()
endif()
set(text "// Written at every build.
#include \"proto/base/version.h\"

std::string_view b4mrl::BuildCommit() { return \"${commit}\"; }
")
set(before "")
if(EXISTS ${OUT})
  file(READ ${OUT} before)
endif()
if(NOT text STREQUAL before)
  file(WRITE ${OUT} "${text}")
endif()
