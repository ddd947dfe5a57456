// Reads variable-length strings of an HDF5 file without the library. HDF5 1.10 allocates as many
// bytes as the reference to a string claims, and copies as many as the heap's entry claims, so a
// crafted file writes past the buffer. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// The string, up to its first NUL, whose reference lies at `address` of the file: 16 bytes, which
// are length, address of the heap and index in the heap. Addresses have 8 bytes and count from the
// file's start. kLimitExceeded above `max_bytes`, kDataLoss where the file has no such string.
Result<std::string> ReadHeapString(int fd, uint64_t address, size_t max_bytes);

}  // namespace b4mrl
