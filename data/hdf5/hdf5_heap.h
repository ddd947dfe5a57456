// Reads variable-length strings of an HDF5 file without the library. HDF5 1.10 allocates as many
// bytes as the reference to a string claims, and copies as many as the heap's entry claims, so a
// crafted file writes past the buffer. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// Reads the string, up to its first NUL, whose reference lies at `address` of the file. A reference
// has 16 bytes: length, address of the heap and index in the heap. Addresses have 8 bytes and count
// from the file's start. kLimitExceeded for a string longer than `max_bytes` bytes, kDataLoss if
// the reference leads to no string.
Result<std::string> ReadHeapString(int fd, uint64_t address, size_t max_bytes);

}  // namespace b4mrl
