// The tasks' own models, as parts of the program: all processes of a daemon simulate the same
// numbers for as long as it runs, whatever an upgrade does to the files of its installation.
#pragma once

#include <string_view>

namespace b4mrl {

// The text of data/models/<file_name>, as it was when the program was built; "" if there is none.
// Any thread.
std::string_view OwnModel(std::string_view file_name);

}  // namespace b4mrl
