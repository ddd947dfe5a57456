// Makes folders. Any thread and process.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// Makes the folder and those around it that are missing; OK if it exists already. Error: kIoError.
Status MakeFolder(const std::string& path);

}  // namespace b4mrl
