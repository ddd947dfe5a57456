// The hash of a dataset's columns, which identifies its rows: equal rows have equal hashes, in
// whatever file, with whatever metadata and compression, and under whatever name they are kept.
//
// It is the SHA-256 of one line for each column of kTransitionColumns, in that order,
//   "<name> <float32|uint8> <rows> <elements of a row> <SHA-256 of the column's bytes>\n"
// where a column's bytes are its rows one after the other, row-major and little-endian, with flags
// as 0 and 1. The columns are those that the importer makes of a file (import_dataset.h). One
// thread at a time.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <tuple>

#include "data/columns/dataset.h"
#include "data/files/file_hash.h"

namespace b4mrl {

class ColumnsHash {
 public:
  // Appends rows, in blocks of any size; all blocks have the same observation and action sizes.
  void Append(const TransitionColumns& block);
  // 64 lower-case hexadecimal digits. Nothing may be called afterwards.
  std::string Hex();

 private:
  TransitionColumns sizes_;  // without rows: observation_size and action_size
  uint64_t rows_ = 0;
  std::array<Sha256, std::tuple_size_v<decltype(kTransitionColumns)>> columns_;
};

}  // namespace b4mrl
