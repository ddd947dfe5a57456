// The folder DATA/.cache, where the daemon's processes keep files that they can make again. Only
// the daemon's user may read DATA/.cache, unless the group may write to DATA: then DATA/.cache has
// the permissions of DATA, as the daemons of the group's members share their caches. The umask does
// not matter. Any thread.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

std::string CacheRoot(const std::string& data_folder);
// Makes the folder DATA/.cache if it is missing, and sets its mode. Error: kIoError.
Status MakeCacheRoot(const std::string& data_folder);
// Makes a folder with the permissions of its parent; OK if it exists already. Error: kIoError.
Status MakeFolderInside(const std::string& folder);

}  // namespace b4mrl
