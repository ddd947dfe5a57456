#include "data/files/atomic_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <utility>

namespace b4mrl {
namespace {

// Such that no file of the user's has it.
constexpr char kSuffix[] = ".b4mrl-tmp";

// Whether a lock was refused with this error because the file system has none.
bool MeansNoLocks(int error_number) {
  return error_number == ENOSYS || error_number == ENOLCK || error_number == EOPNOTSUPP;
}

}  // namespace

AtomicFile::AtomicFile(std::string path, std::string temporary_path, UniqueFd fd)
    : path_(std::move(path)), temporary_path_(std::move(temporary_path)), fd_(std::move(fd)) {}

AtomicFile::~AtomicFile() {
  if (fd_.valid()) unlink(temporary_path_.c_str());
}

Result<AtomicFile> AtomicFile::Create(const std::string& path, std::optional<mode_t> mode) {
  const std::string temporary = path + kSuffix;
  constexpr int kAttempts = 10;
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    UniqueFd fd(open(temporary.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0644));
    if (!fd.valid()) return IoError("create", temporary, errno);
    if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
      if (MeansNoLocks(errno)) {
        // Nobody's, but where locks ran short for a moment: then it may be another writer's.
        if (errno != ENOLCK) unlink(temporary.c_str());
        return CreateWithoutLock(path, mode);
      }
      if (errno != EWOULDBLOCK) return IoError("lock", temporary, errno);
      return Status(StatusCode::kBusy, fmt::format("another process is writing {}", path));
    }
    // If another writer commits between our open and our lock, ours is its finished file.
    if (!StillNamed(fd.get(), temporary)) continue;
    if (ftruncate(fd.get(), 0) != 0) return IoError("truncate", temporary, errno);
    if (mode && fchmod(fd.get(), *mode) != 0) return IoError("set the mode of", temporary, errno);
    return AtomicFile(path, temporary, std::move(fd));
  }
  return Status(StatusCode::kBusy, fmt::format("other processes keep replacing {}", path));
}

Result<AtomicFile> AtomicFile::CreateWithoutLock(const std::string& path,
                                                 std::optional<mode_t> mode) {
  uint64_t drawn = 0;
  (void)!getrandom(&drawn, sizeof(drawn), 0);  // never shortened (getrandom(2))
  const std::string temporary = fmt::format("{}{}-{:016x}", path, kSuffix, drawn);
  UniqueFd fd(open(temporary.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
  if (!fd.valid()) return IoError("create", temporary, errno);
  AtomicFile file(path, temporary, std::move(fd));
  if (mode && fchmod(file.fd(), *mode) != 0) return IoError("set the mode of", temporary, errno);
  return file;
}

bool StillNamed(int fd, const std::string& path) {
  struct stat held {};
  struct stat named {};
  return fstat(fd, &held) == 0 && stat(path.c_str(), &named) == 0 && held.st_dev == named.st_dev &&
         held.st_ino == named.st_ino;
}

bool IsBeingWritten(const std::string& path) {
  const std::string temporary = path + kSuffix;
  const UniqueFd fd(open(temporary.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  return fd.valid() && flock(fd.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

Status AtomicFile::Write(std::string_view text) {
  return WriteFully(fd_.get(), std::as_bytes(std::span(text)), path_);
}

Status AtomicFile::Commit(Existing existing) {
  if (!fd_.valid()) {
    return Status(StatusCode::kFailedPrecondition, fmt::format("{} is already committed", path_));
  }
  if (fsync(fd_.get()) != 0) return IoError("flush", temporary_path_, errno);
  B4MRL_RETURN_IF_ERROR(MoveTo(temporary_path_, path_, existing));
  // A child that another thread has just forked has the file open until it executes its program:
  // closing alone would leave the lock until then, and readers would take the file for one that is
  // being removed.
  flock(fd_.get(), LOCK_UN);
  fd_.Reset();
  return SyncFolder(FolderOf(path_));
}

int RenameIfAbsent(const char* from, const char* to) {
  const int failed = renameat2(AT_FDCWD, from, AT_FDCWD, to, RENAME_NOREPLACE);
  if (failed == 0 || (errno != EINVAL && errno != ENOSYS)) return failed;
  if (access(to, F_OK) == 0) {
    errno = EEXIST;
    return -1;
  }
  return rename(from, to);
}

Status MoveTo(const std::string& from, const std::string& to, Existing existing) {
  const bool keeps = existing == Existing::kKeep;
  const int failed =
      keeps ? RenameIfAbsent(from.c_str(), to.c_str()) : rename(from.c_str(), to.c_str());
  if (failed == 0) return Status();
  if (keeps && errno == EEXIST) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("{} appeared in the meantime and is kept", to));
  }
  return IoError("replace", to, errno);
}

Status WriteFully(int fd, std::span<const std::byte> bytes, std::string_view path) {
  while (!bytes.empty()) {
    const ssize_t written = write(fd, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return IoError("write", path, errno);
    bytes = bytes.subspan(static_cast<size_t>(written));
  }
  return Status();
}

Status SyncFolder(const std::string& folder) {
  const UniqueFd fd(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (!fd.valid()) return IoError("open folder", folder, errno);
  if (fsync(fd.get()) != 0) return IoError("flush folder", folder, errno);
  return Status();
}

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

Status WriteSmallFile(const std::string& path, std::string_view text, std::optional<mode_t> mode) {
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path, mode));
  B4MRL_RETURN_IF_ERROR(file.Write(text));
  return file.Commit();
}

Result<std::string> ReadSmallFile(const std::string& path, size_t max_bytes, FileKinds kinds) {
  const int no_waiting = kinds == FileKinds::kRegular ? O_NONBLOCK : 0;
  const UniqueFd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC | no_waiting));
  if (!fd.valid()) return IoError("open", path, errno);
  struct stat info {};
  if (fstat(fd.get(), &info) != 0) return IoError("inspect", path, errno);
  if (kinds == FileKinds::kRegular && !S_ISREG(info.st_mode)) {
    return Status(StatusCode::kIoError, fmt::format("{} is not a regular file", path));
  }
  // Room for most files at once; what is larger doubles it.
  std::string text(std::min<size_t>(max_bytes + 1, 64 << 10), '\0');
  size_t length = 0;
  while (length <= max_bytes) {
    if (length == text.size()) text.resize(std::min(2 * length, max_bytes + 1));
    const ssize_t got = read(fd.get(), text.data() + length, text.size() - length);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return IoError("read", path, errno);
    if (got == 0) break;
    length += static_cast<size_t>(got);
  }
  if (length > max_bytes) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} is longer than {} bytes", path, max_bytes));
  }
  text.resize(length);
  return text;
}

mode_t ModeInside(const std::string& folder) {
  struct stat info {};
  return stat(folder.c_str(), &info) == 0 ? info.st_mode & 02777 : 0700;
}

}  // namespace b4mrl
