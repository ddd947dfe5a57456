// Writes a dataset as a table of text, in a stream: a header line and a line for each row, with
// the columns
//   observation_0, ..., action_0, ..., reward, next_observation_0, ..., terminal, timeout
//
// A number is the shortest text that NumPy and pandas read as the same float32, although they parse
// it as float64 first; "nan", "inf" and "-inf" stand for themselves, and flags are 0 or 1. The file
// appears complete or not at all (atomic_file.h). Thread rule: one thread. Errors: kIoError,
// kInvalidArgument (array sizes).
#pragma once

#include <cstdint>
#include <string>

#include "data/d4rl/dataset_file_writer.h"
#include "data/files/atomic_file.h"
#include "proto/base/status.h"

namespace b4mrl {

class DatasetCsvWriter {
 public:
  static Result<DatasetCsvWriter> Create(const std::string& path, uint32_t observation_size,
                                         uint32_t action_size);

  // Appends rows with observations, actions, rewards, next observations, terminals and timeouts.
  Status Append(const DatasetRows& rows);
  // Makes the file appear. Nothing may be called afterwards.
  Status Commit(Existing existing = Existing::kReplace);

 private:
  DatasetCsvWriter(AtomicFile file, uint32_t observation_size, uint32_t action_size);

  AtomicFile file_;
  uint32_t observation_size_, action_size_;
  std::string text_;  // of the rows that are being appended
};

}  // namespace b4mrl
