#include "algorithms/run/appended_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <span>
#include <utility>

#include "data/files/atomic_file.h"

namespace b4mrl {

Status AppendedFile::Check(const std::string& path, uint64_t bytes) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0 && errno != ENOENT) return IoError("inspect", path, errno);
  if (static_cast<uint64_t>(info.st_size) >= bytes) return Status();
  return Status(StatusCode::kDataLoss,
                fmt::format("{} has {} bytes, the checkpoint says {}", path, info.st_size, bytes));
}

Result<AppendedFile> AppendedFile::Open(const std::string& path, uint64_t bytes) {
  const int create = bytes == 0 ? O_TRUNC : 0;
  UniqueFd fd(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC | create, 0644));
  if (!fd.valid()) return IoError("open", path, errno);
  B4MRL_RETURN_IF_ERROR(Check(path, bytes));
  const auto length = static_cast<off_t>(bytes);  // not more than the file has
  if (ftruncate(fd.get(), length) != 0) return IoError("cut", path, errno);
  if (lseek(fd.get(), length, SEEK_SET) < 0) return IoError("seek", path, errno);
  return AppendedFile(path, std::move(fd), bytes);
}

Status AppendedFile::Append(std::string_view text) {
  B4MRL_RETURN_IF_ERROR(WriteFully(fd_.get(), std::as_bytes(std::span(text)), path_));
  bytes_ += text.size();
  return Status();
}

Status AppendedFile::Sync() {
  return fsync(fd_.get()) == 0 ? Status() : IoError("sync", path_, errno);
}

}  // namespace b4mrl
