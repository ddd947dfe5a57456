#include "data/files/folder_listing.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Below the folder itself. Links may lead back to where they are.
constexpr int kMostDepth = 8;

bool IsFileOf(const fs::directory_entry& entry, std::string_view extension) {
  // Opening a pipe would wait for whoever writes into it.
  std::error_code gone;
  return entry.is_regular_file(gone) && entry.path().extension() == extension;
}

}  // namespace

Result<std::vector<std::string>> FilesIn(const std::string& folder, std::string_view extension) {
  std::vector<std::string> paths;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    if (IsFileOf(*entry, extension)) paths.push_back(entry->path());
  }
  if (error) return IoError("list", folder, error.value());
  std::ranges::sort(paths);
  return paths;
}

Result<std::vector<std::string>> FilesBelow(const std::string& folder, std::string_view extension) {
  std::vector<std::string> paths;
  std::error_code error;
  constexpr auto kFollow = fs::directory_options::follow_directory_symlink;
  for (fs::recursive_directory_iterator entry(folder, kFollow, error), end; !error && entry != end;
       entry.increment(error)) {
    if (entry.depth() >= kMostDepth) entry.disable_recursion_pending();
    if (IsFileOf(*entry, extension)) paths.push_back(entry->path());
  }
  if (error) return IoError("list", folder, error.value());
  std::ranges::sort(paths);
  return paths;
}

}  // namespace b4mrl
