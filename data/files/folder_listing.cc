#include "data/files/folder_listing.h"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <system_error>
#include <utility>

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr int kMostDepth = 8;  // below the folder itself

// Device and inode. Links may lead back to where they are, and many of them to one folder.
using FolderId = std::pair<dev_t, ino_t>;
FolderId IdOf(const fs::path& folder) {
  struct stat info {};
  return stat(folder.c_str(), &info) == 0 ? FolderId(info.st_dev, info.st_ino) : FolderId();
}

Result<std::vector<std::string>> FilesUpTo(int depth, const std::string& folder,
                                           std::string_view extension) {
  std::vector<std::string> paths;
  std::set<FolderId> visited;
  // Level by level and sorted, so that of several ways to a folder the shortest is taken.
  std::vector<fs::path> level = {folder};
  for (int i = 0; i <= depth && !level.empty(); ++i) {
    std::vector<fs::path> inside;
    for (const fs::path& each : level) {
      if (!visited.insert(IdOf(each)).second) continue;
      std::error_code error;
      for (fs::directory_iterator entry(each, error), end; !error && entry != end;
           entry.increment(error)) {
        std::error_code gone;
        if (entry->is_directory(gone)) {
          inside.push_back(entry->path());
        } else if (entry->path().extension() == extension && entry->is_regular_file(gone)) {
          paths.push_back(entry->path());  // no pipe, which would keep waiting whoever opens it
        }
      }
      if (error) return IoError("list", each.string(), error.value());
    }
    std::ranges::sort(inside);
    level = std::move(inside);
  }
  std::ranges::sort(paths);
  return paths;
}

}  // namespace

Result<std::vector<std::string>> FilesIn(const std::string& folder, std::string_view extension) {
  return FilesUpTo(0, folder, extension);
}

Result<std::vector<std::string>> FilesBelow(const std::string& folder, std::string_view extension) {
  return FilesUpTo(kMostDepth, folder, extension);
}

}  // namespace b4mrl
