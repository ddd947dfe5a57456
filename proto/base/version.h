// The project's version, as "0.1.0", from `project` in CMakeLists.txt.
#pragma once

#include <string_view>

namespace b4mrl {

std::string_view ProjectVersion();

}  // namespace b4mrl
