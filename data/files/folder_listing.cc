#include "data/files/folder_listing.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Below the folder itself. Links may lead back to where they are.
constexpr int kMostDepth = 8;

Result<std::vector<std::string>> FilesUpTo(int depth, const std::string& folder,
                                           std::string_view extension) {
  std::vector<std::string> paths;
  std::error_code error;
  constexpr auto kFollow = fs::directory_options::follow_directory_symlink;
  for (fs::recursive_directory_iterator entry(folder, kFollow, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry.depth() >= depth) entry.disable_recursion_pending();
    // Opening a pipe would wait for whoever writes into it.
    std::error_code gone;
    const bool is_file = entry->is_regular_file(gone);
    if (is_file && entry->path().extension() == extension) paths.push_back(entry->path());
  }
  if (error) return IoError("list", folder, error.value());
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
