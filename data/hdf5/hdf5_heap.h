// Variable-length strings of an HDF5 file, read without the library: HDF5 1.10 copies as many bytes
// as the heap's entry claims into a buffer that it made as large as the reference to it claims, so
// a crafted file writes past that buffer. Any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

#include "proto/base/status.h"

namespace b4mrl {

// The string whose reference (length, address of the heap, index in it; 16 bytes) lies at `address`
// of the file, up to its first NUL. The file's addresses have 8 bytes and count from its start.
// kLimitExceeded above `max_bytes`, kDataLoss where the file has no such string.
Result<std::string> ReadHeapString(int fd, uint64_t address, size_t max_bytes);

}  // namespace b4mrl
