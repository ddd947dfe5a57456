// A file that appears complete or not at all.
//
// Bytes go to "<path>.b4mrl-tmp"; Commit flushes and fsyncs them, renames the file into place and
// fsyncs the folder. Destroyed before Commit, the temporary file is removed; left behind by a
// killed process, it is overwritten by the next writer. A lock on the temporary file refuses a
// second writer (kBusy). On a file system without locks, every writer has a temporary file of its
// own, "<path>.b4mrl-tmp-<random>": the last to commit wins, and what a killed one leaves stays.
// Thread rule: one thread. Ownership: owns the descriptor until destruction.
// Errors: kIoError with path and reason (full disk, permissions, missing folder), kBusy;
// kFailedPrecondition if a file is there that is to be kept.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// What Commit does with a file that is at the path by then.
enum class Existing { kReplace, kKeep };

class AtomicFile {
 public:
  // Opens the temporary file. It gets `mode`, whatever the umask; without `mode`, 0644 less umask.
  static Result<AtomicFile> Create(const std::string& path, std::optional<mode_t> mode = {});
  AtomicFile(AtomicFile&& other) noexcept = default;
  AtomicFile& operator=(AtomicFile&&) = delete;
  ~AtomicFile();

  int fd() const { return fd_.get(); }
  const std::string& path() const { return path_; }
  // Writes all of `text` at the descriptor's position; continues after short writes.
  Status Write(std::string_view text);
  Status Commit(Existing existing = Existing::kReplace);

 private:
  AtomicFile(std::string path, std::string temporary_path, UniqueFd fd);
  static Result<AtomicFile> CreateWithoutLock(const std::string& path, std::optional<mode_t> mode);

  std::string path_;
  std::string temporary_path_;
  UniqueFd fd_;  // open until Commit succeeds or another object takes the file over
};

// Whether `path` still names the file of `fd`.
bool StillNamed(int fd, const std::string& path);
// Whether an AtomicFile of this path is open, in any process. Without locks, never.
bool IsBeingWritten(const std::string& path);
// Renames without replacing anything: -1, with errno EEXIST, if there is something at `to`. Where
// the file system cannot do that, as NFS, what appears between the look and the rename is replaced.
int RenameIfAbsent(const char* from, const char* to);
// Puts a complete file in its place. kFailedPrecondition if one is there that is to be kept.
Status MoveTo(const std::string& from, const std::string& to, Existing existing);
// Writes all of `bytes` to `fd`; `path` is for error messages.
Status WriteFully(int fd, std::span<const std::byte> bytes, std::string_view path);
// Makes renames and creations of files in `folder` durable (fsync of the folder).
Status SyncFolder(const std::string& folder);
// The folder part of a path; "." for a path without a folder.
std::string FolderOf(const std::string& path);
// The mode for a folder that is made in `folder`: that of `folder`, set-group-ID included, whatever
// the umask.
mode_t ModeInside(const std::string& folder);
// Writes a whole file by an AtomicFile, so that it appears complete or not at all.
Status WriteSmallFile(const std::string& path, std::string_view text,
                      std::optional<mode_t> mode = {});
// A pipe, say, keeps whoever opens it waiting until somebody writes into it.
enum class FileKinds { kRegular, kAny };
// Reads a whole file; kLimitExceeded if it is longer than `max_bytes`, kIoError for another kind.
Result<std::string> ReadSmallFile(const std::string& path, size_t max_bytes,
                                  FileKinds kinds = FileKinds::kRegular);

}  // namespace b4mrl
