#include "server/gateway/data_folder.h"

#include <filesystem>
#include <system_error>

#include "proto/base/folders.h"

namespace b4mrl {
namespace {

std::string Absolute(const std::string& folder) {
  std::error_code error;
  const std::string absolute = std::filesystem::absolute(folder, error).lexically_normal().string();
  return error ? folder : absolute;
}

}  // namespace

DataFolder::DataFolder(const std::string& path)
    : path_(Absolute(path)), identity_([path = path_] { return FolderIdentity(path); }) {}

}  // namespace b4mrl
