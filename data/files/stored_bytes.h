// Counts the bytes that a file really stores. A sparse file may claim any size at no cost to its
// writer, so limits on time and memory follow the stored bytes, not the file's size. Any thread.
#pragma once

#include <cstdint>

namespace b4mrl {

// The bytes of a regular file without its holes; 0 for other kinds of file. Moves the file's
// position. Counts at most the first 65,536 pieces between holes. On a file system without holes,
// returns the file's size.
uint64_t StoredBytes(int fd);

}  // namespace b4mrl
