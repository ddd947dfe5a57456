// The daemon's data folder, as far as the gateway uses it. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>

#include "server/gateway/folder_look.h"

namespace b4mrl {

class DataFolder {
 public:
  explicit DataFolder(const std::string& path);

  const std::string& path() const { return path_; }  // absolute
  // FolderIdentity: 0 if there is no such folder, or if it has not answered yet. While it does not
  // answer, that of the last look (FolderLook::Latest).
  uint64_t Identity() { return identity_.Latest(); }
  // Has `work` done on the folder's thread; false while earlier work is not done.
  bool TryRun(std::function<void()> work) { return identity_.TryRun(std::move(work)); }

 private:
  const std::string path_;
  FolderLook<uint64_t> identity_;
};

}  // namespace b4mrl
