#include "data/files/stored_bytes.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

namespace b4mrl {

// Does not use st_blocks, which some file systems report late or not at all.
uint64_t StoredBytes(int fd) {
  constexpr int kMaxPieces = 65536;
  struct stat info {};
  if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) return 0;
  uint64_t stored = 0;
  off_t end = 0;
  for (int piece = 0; piece < kMaxPieces; ++piece) {
    const off_t begin = lseek(fd, end, SEEK_DATA);
    if (begin < 0 && errno == ENXIO) break;  // a hole up to the end
    end = begin < 0 ? -1 : lseek(fd, begin, SEEK_HOLE);
    if (end < 0) return static_cast<uint64_t>(info.st_size);
    stored += static_cast<uint64_t>(end - begin);
  }
  return stored;
}

}  // namespace b4mrl
