#include "data/files/make_folder.h"

#include <filesystem>
#include <system_error>

namespace b4mrl {

Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  return error ? IoError("make the folder", path, error.value()) : Status();
}

}  // namespace b4mrl
