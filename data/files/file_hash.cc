#include "data/files/file_hash.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <cerrno>
#include <vector>

#include "proto/base/unique_fd.h"

namespace b4mrl {
namespace {

std::string Hexadecimal(std::span<const unsigned char> bytes) {
  std::string text;
  for (const unsigned char byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

}  // namespace

Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr);
}

void Sha256::Free::operator()(evp_md_ctx_st* context) const { EVP_MD_CTX_free(context); }

void Sha256::Update(std::span<const std::byte> bytes) {
  EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size());
}

std::string Sha256::Hex() {
  unsigned char digest[EVP_MAX_MD_SIZE];
  unsigned int size = 0;
  EVP_DigestFinal_ex(context_.get(), digest, &size);
  return Hexadecimal(std::span(digest, size));
}

Result<std::string> Sha256OfDescriptor(int fd, const std::string& path,
                                       const std::function<Status()>& go_on) {
  constexpr size_t kBlockBytes = 1 << 20;
  std::vector<std::byte> block(kBlockBytes);
  Sha256 hash;
  off_t offset = 0;
  while (true) {
    B4MRL_RETURN_IF_ERROR(go_on());
    const ssize_t got = pread(fd, block.data(), block.size(), offset);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return IoError("read", path, errno);
    if (got == 0) return hash.Hex();
    hash.Update(std::span(block).first(static_cast<size_t>(got)));
    offset += got;
  }
}

Result<std::string> Sha256OfFile(const std::string& path, uint64_t max_bytes,
                                 const std::function<Status()>& go_on) {
  const UniqueFd fd(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd.valid()) return IoError("open", path, errno);
  struct stat info {};
  if (fstat(fd.get(), &info) != 0) return IoError("inspect", path, errno);
  if (static_cast<uint64_t>(info.st_size) > max_bytes) {
    return Status(StatusCode::kLimitExceeded, fmt::format("{} has {} bytes, allowed: at most {}",
                                                          path, info.st_size, max_bytes));
  }
  return Sha256OfDescriptor(fd.get(), path, go_on);
}

std::string Sha256OfText(std::string_view text) {
  Sha256 hash;
  hash.Update(std::as_bytes(std::span(text)));
  return hash.Hex();
}

StreamHash::StreamHash() : state_(XXH3_createState()) { XXH3_128bits_reset(state_.get()); }

void StreamHash::Free::operator()(XXH3_state_s* state) const { XXH3_freeState(state); }

void StreamHash::Update(std::span<const std::byte> bytes) {
  XXH3_128bits_update(state_.get(), bytes.data(), bytes.size());
}

std::string StreamHash::Hex() const {
  XXH128_canonical_t canonical;
  XXH128_canonicalFromHash(&canonical, XXH3_128bits_digest(state_.get()));
  return Hexadecimal(canonical.digest);
}

bool IsHash128(std::string_view text) {
  return text.size() == 32 && text.find_first_not_of("0123456789abcdef") == text.npos;
}

}  // namespace b4mrl
