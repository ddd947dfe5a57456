#include "proto/base/folders.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "proto/base/child_program.h"
#include "proto/base/rng.h"

namespace b4mrl {

std::string DefaultDataFolder() {
  const char* own = std::getenv("B4MRL_DATA");
  if (own != nullptr && *own != '\0') return own;
  const char* data = std::getenv("XDG_DATA_HOME");
  if (data != nullptr && *data == '/') return fmt::format("{}/b4mrl", data);
  const char* home = std::getenv("HOME");
  if (home != nullptr && *home == '/') return fmt::format("{}/.local/share/b4mrl", home);
  return "/var/lib/.local/share/b4mrl";
}

std::string DefaultCacheFolder() {
  const char* cache = std::getenv("XDG_CACHE_HOME");
  if (cache != nullptr && *cache == '/') return fmt::format("{}/b4mrl", cache);
  const char* home = std::getenv("HOME");
  if (home != nullptr && *home == '/') return fmt::format("{}/.cache/b4mrl", home);
  return "";
}

uint64_t FolderIdentity(const std::string& path) {
  // The boot id stays the same until the machine restarts, so its file is read once.
  static const std::string boot = [] {
    std::ifstream kernel("/proc/sys/kernel/random/boot_id");
    std::string line;
    std::getline(kernel, line);
    return line;
  }();
  struct stat info {};
  if (boot.empty() || stat(path.c_str(), &info) != 0 || !S_ISDIR(info.st_mode)) {
    return 0;
  }
  return HashName(fmt::format("{} {} {}", boot, info.st_dev, info.st_ino));
}

std::string SharedFolder(std::string_view name, const std::string& in_source_tree) {
  namespace fs = std::filesystem;
  const fs::path program_folder = fs::path(ProgramBesideThisOne("")).parent_path();
  fs::path installed = program_folder.parent_path() / "lib" / "b4mrl";
  if (!name.empty()) installed /= name;  // an empty one would add a slash
  std::error_code error;
  return fs::is_directory(installed, error) ? installed.string() : in_source_tree;
}

}  // namespace b4mrl
