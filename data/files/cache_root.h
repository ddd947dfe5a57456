// The folder DATA/.b4mrl-cache, where the daemon's processes keep files that they can make again.
// Only the daemon's user may read it, unless the group may write to DATA: then it has the
// permissions of DATA, as the daemons of the group's members share their caches. The umask does not
// matter. Where the daemon cannot write there, as on a read-only file system, a folder of this
// user's cache stands in for it. Any thread.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// DATA/.b4mrl-cache, or data-<hash of the path DATA> in the user's own cache (DefaultCacheFolder)
// if this process may not write there, nor where it would be made, and the user has a cache.
std::string CacheRoot(const std::string& data_folder);
// Makes that folder, and those around it, if they are missing, and sets its mode. Error: kIoError.
Status MakeCacheRoot(const std::string& data_folder);
// Makes a folder with the permissions of its parent; OK if it exists already. Error: kIoError.
Status MakeFolderInside(const std::string& folder);

}  // namespace b4mrl
