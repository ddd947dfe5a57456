// The files of a folder. Any thread.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

// Paths of the folder's entries whose names have this extension (".json"), sorted. kIoError if the
// folder cannot be listed.
Result<std::vector<std::string>> FilesIn(const std::string& folder, std::string_view extension);
// The same of the folder and those inside it, eight deep, also behind links: clusters keep what is
// large elsewhere. A folder to which several ways lead is listed once, by the
// shortest.
Result<std::vector<std::string>> FilesBelow(const std::string& folder, std::string_view extension);

}  // namespace b4mrl
