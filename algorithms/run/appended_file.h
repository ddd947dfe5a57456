// An append-only log, which a resumed run first cuts back to the length that its checkpoint stores.
//
// Each Append is one write call, which only a disk that is nearly full cuts short: a reader passes
// over an entry without its end. Thread rule: one thread. Errors: kIoError; kDataLoss when the file
// is shorter than that length.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

class AppendedFile {
 public:
  // Whether Open with so many bytes would find them: kDataLoss if not. Changes nothing.
  static Status Check(const std::string& path, uint64_t bytes);
  // Opens the file cut to its first `bytes` bytes; 0: an empty file, created if there is none.
  static Result<AppendedFile> Open(const std::string& path, uint64_t bytes);

  Status Append(std::string_view text);
  // Makes all appended entries durable (fsync).
  Status Sync();
  uint64_t bytes() const { return bytes_; }

 private:
  AppendedFile(std::string path, UniqueFd fd, uint64_t bytes)
      : path_(std::move(path)), fd_(std::move(fd)), bytes_(bytes) {}

  std::string path_;
  UniqueFd fd_;
  uint64_t bytes_;
};

}  // namespace b4mrl
