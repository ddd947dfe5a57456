// How much of a file is really there. A sparse file claims any size and costs its writer nothing,
// so what is spent on a file is measured by this, not by its size. Any thread.
#pragma once

#include <cstdint>

namespace b4mrl {

// The bytes of a regular file without its holes; 0 for anything else. Moves the file's position.
// Of a file in more than 65,536 pieces only the first ones count. Where the file system knows no
// holes, the file's size.
uint64_t StoredBytes(int fd);

}  // namespace b4mrl
