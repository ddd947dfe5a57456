// DATA/.cache, where the daemon's processes keep what they can make again, and who may look into
// it: its user alone, or, where DATA can be written by its group, everybody whom DATA lets in, for
// then the group's daemons share their caches. The umask has no say. Any thread.
#pragma once

#include <string>

#include "proto/base/status.h"

namespace b4mrl {

std::string CacheRoot(const std::string& data_folder);
// Makes it, or gives the one that is there its mode. kIoError.
Status MakeCacheRoot(const std::string& data_folder);
// Makes a folder as open as the one that it lies in; content with one that is there. kIoError.
Status MakeFolderInside(const std::string& folder);

}  // namespace b4mrl
