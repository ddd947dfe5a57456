#include "data/hdf5/hdf5_heap.h"

#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cstring>
#include <limits>

namespace b4mrl {
namespace {

// The header of a collection of the global heap: "GCOL", version, three zeros, size of the
// collection.
constexpr std::array<char, 8> kHeapStart = {'G', 'C', 'O', 'L', 1, 0, 0, 0};
// Bytes of the header of an object in a collection: index, reference count, four zeros, size.
// Objects begin at multiples of 8 bytes; index 0 is the free space behind the last object.
constexpr uint64_t kHeaderBytes = 16;

bool ReadAt(int fd, uint64_t address, void* out, size_t bytes) {
  if (address > static_cast<uint64_t>(std::numeric_limits<off_t>::max()) - bytes) return false;
  return pread(fd, out, bytes, static_cast<off_t>(address)) == static_cast<ssize_t>(bytes);
}

template <typename T>
T NumberAt(const std::array<char, kHeaderBytes>& bytes, size_t offset) {
  T number = 0;
  std::memcpy(&number, bytes.data() + offset, sizeof(T));  // files and processor: little-endian
  return number;
}

}  // namespace

Result<std::string> ReadHeapString(int fd, uint64_t address, size_t max_bytes) {
  const Status damaged(StatusCode::kDataLoss, "refers to a string that is not in the file");
  std::array<char, kHeaderBytes> header{};
  if (!ReadAt(fd, address, header.data(), header.size())) return damaged;
  const auto length = NumberAt<uint32_t>(header, 0);
  const auto heap = NumberAt<uint64_t>(header, 4);
  const auto wanted = NumberAt<uint32_t>(header, 12);
  if (length == 0) return std::string();
  if (length > max_bytes) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("has {} bytes, allowed: {}", length, max_bytes));
  }
  if (!ReadAt(fd, heap, header.data(), header.size()) ||
      std::memcmp(header.data(), kHeapStart.data(), kHeapStart.size()) != 0) {
    return damaged;
  }
  const auto heap_bytes = NumberAt<uint64_t>(header, 8);
  uint64_t offset = kHeaderBytes;
  // An index has 16 bits, so no heap has more objects.
  for (uint32_t object = 0; object <= 0xffff && offset + kHeaderBytes <= heap_bytes; ++object) {
    if (!ReadAt(fd, heap + offset, header.data(), header.size())) return damaged;
    const auto index = NumberAt<uint16_t>(header, 0);
    const auto size = NumberAt<uint64_t>(header, 8);
    offset += kHeaderBytes;
    if (index == 0 || size > heap_bytes - offset) return damaged;
    if (index == wanted) {
      std::string text(length, '\0');
      if (length > size || !ReadAt(fd, heap + offset, text.data(), length)) return damaged;
      return text.substr(0, text.find('\0'));
    }
    offset += (size + 7) / 8 * 8;
  }
  return damaged;
}

}  // namespace b4mrl
