#include "data/files/folder_listing.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

namespace b4mrl {

Result<std::vector<std::string>> FilesIn(const std::string& folder, std::string_view extension) {
  std::vector<std::string> paths;
  std::error_code error;
  for (std::filesystem::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    // Opening a pipe would wait for whoever writes into it.
    std::error_code gone;
    const bool is_file = entry->is_regular_file(gone);
    if (is_file && entry->path().extension() == extension) paths.push_back(entry->path());
  }
  if (error) return IoError("list", folder, error.value());
  std::ranges::sort(paths);
  return paths;
}

}  // namespace b4mrl
