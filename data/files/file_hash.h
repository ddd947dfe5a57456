// Hashes that name and protect files. SHA-256 identifies a source file to people and other
// programs; XXH3 (128 bits) detects damage in files that this project wrote. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "proto/base/status.h"

struct XXH3_state_s;   // of xxhash.h
struct evp_md_ctx_st;  // of openssl/evp.h

namespace b4mrl {

// SHA-256 of a stream of bytes. One thread at a time.
class Sha256 {
 public:
  Sha256();
  void Update(std::span<const std::byte> bytes);
  // 64 lower-case hexadecimal digits. Nothing may be called afterwards.
  std::string Hex();

 private:
  struct Free {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, Free> context_;
};

// The file's SHA-256 as 64 lower-case hexadecimal digits. kLimitExceeded for a longer file than
// `max_bytes`. Calls `go_on` between blocks of 1 MiB; an error of `go_on` ends the call.
Result<std::string> Sha256OfFile(
    const std::string& path, uint64_t max_bytes = UINT64_MAX,
    const std::function<Status()>& go_on = [] { return Status(); });
// The SHA-256 of an open file, read from start to end without moving the descriptor's position;
// `path` is for messages. Calls `go_on` as Sha256OfFile does.
Result<std::string> Sha256OfDescriptor(int fd, const std::string& path,
                                       const std::function<Status()>& go_on);
std::string Sha256OfText(std::string_view text);

// Whether `text` is 32 lower-case hexadecimal digits, as the names of column caches and compiled
// models are.
bool IsHash128(std::string_view text);

// XXH3-128 of a stream of bytes, as 32 lower-case hexadecimal digits. One thread at a time.
class StreamHash {
 public:
  StreamHash();
  void Update(std::span<const std::byte> bytes);
  std::string Hex() const;

 private:
  struct Free {
    void operator()(XXH3_state_s* state) const;
  };
  std::unique_ptr<XXH3_state_s, Free> state_;
};

}  // namespace b4mrl
