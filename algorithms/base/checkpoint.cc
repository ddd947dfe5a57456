#include "algorithms/base/checkpoint.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <utility>

#include "proto/base/finite.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

constexpr std::string_view kPrefix = "checkpoint-";
constexpr std::string_view kSuffix = ".h5";

// A core may show "log_alpha" and "log_alpha/adam/steps"; HDF5 cannot have both a dataset and a
// group of one name, so a core's names become one level.
std::string Join(std::string_view prefix, std::string_view name) {
  std::string flat(name);
  std::replace(flat.begin(), flat.end(), '/', '.');
  return fmt::format("{}/{}", prefix, flat);
}

std::string LengthName(std::string_view name) { return fmt::format("{}_length", name); }

constexpr double kMaxInteger = 9007199254740992;  // 2^53: HDF5 numbers are read back as double

// A damaged file may hold any number, and a cast of one that the type lacks is undefined.
Status CheckWhole(std::string_view name, double value, double most) {
  if (value >= 0 && value <= most && value == std::floor(value)) return Status();
  return Status(StatusCode::kDataLoss,
                fmt::format("{} is {}, allowed: a whole number in 0..{:.0f}", name, value, most));
}

}  // namespace

Result<CheckpointWriter> CheckpointWriter::Create(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file, Hdf5Writer::Create(path));
  return CheckpointWriter(std::move(file));
}

void CheckpointWriter::Integer(std::string_view name, int64_t value) {
  if (status_.ok()) Note(file_.WriteInteger(name, value));
}

// Stored as text: HDF5 numbers are read back as double, which would keep only 53 of 64 bits.
void CheckpointWriter::Unsigned(std::string_view name, uint64_t value) {
  Text(name, fmt::format("{}", value));
}

void CheckpointWriter::Number(std::string_view name, double value) {
  if (status_.ok()) Note(file_.WriteNumber(name, value));
}

void CheckpointWriter::Text(std::string_view name, std::string_view text) {
  if (status_.ok()) Note(file_.WriteString(name, text));
}

void CheckpointWriter::Floats(std::string_view name, std::span<const float> values) {
  Unsigned(LengthName(name), values.size());
  if (!status_.ok() || values.empty()) return;
  const uint64_t shape[] = {values.size()};
  Note(file_.WriteArray(name, values, shape));
}

void CheckpointWriter::Bytes(std::string_view name, std::span<const uint8_t> values) {
  Unsigned(LengthName(name), values.size());
  if (!status_.ok() || values.empty()) return;
  auto column = file_.CreateColumn(name, {.type = Hdf5Type::kInteger});
  Note(column.ok() ? file_.Append(*column, values) : column.status());
}

ArrayVisitor<float> CheckpointWriter::Arrays(std::string prefix) {
  return [this, prefix = std::move(prefix)](const NamedArray<float>& array) {
    const std::string name = Join(prefix, array.name);
    if (!AllFinite(array.values) && !first_nonfinite_) first_nonfinite_ = name;
    Floats(name, array.values);
  };
}

CounterVisitor CheckpointWriter::Counters(std::string prefix) {
  return [this, prefix = std::move(prefix)](const NamedCounter& counter) {
    Integer(Join(prefix, counter.name), *counter.value);
  };
}

Status CheckpointWriter::Commit() {
  B4MRL_RETURN_IF_ERROR(status_);
  return file_.Commit();
}

Result<CheckpointReader> CheckpointReader::Open(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Reader file, Hdf5Reader::Open(path));
  return CheckpointReader(std::move(file));
}

int64_t CheckpointReader::Integer(std::string_view name) {
  const double value = Number(name);
  if (status_.ok()) status_ = CheckWhole(name, value, kMaxInteger);
  return status_.ok() ? static_cast<int64_t>(value) : 0;
}

uint64_t CheckpointReader::Unsigned(std::string_view name) {
  const std::string text = Text(name);
  if (!status_.ok()) return 0;
  return Take(ParseUnsigned(name, text, 0, UINT64_MAX));
}

double CheckpointReader::Number(std::string_view name) {
  if (!status_.ok()) return 0;
  return Take(file_.ReadNumber(name));
}

std::string CheckpointReader::Text(std::string_view name) {
  if (!status_.ok()) return {};
  return Take(file_.ReadString(name));
}

std::vector<float> CheckpointReader::Floats(std::string_view name) {
  const uint64_t length = Unsigned(LengthName(name));
  if (!status_.ok() || length == 0) return {};
  std::vector<float> values = Take(file_.ReadFloats(name));
  if (status_.ok() && values.size() != length) {
    status_ = Status(StatusCode::kDataLoss, fmt::format("{} has {} values where {} were written",
                                                        name, values.size(), length));
  }
  return values;
}

std::vector<uint8_t> CheckpointReader::Bytes(std::string_view name) {
  std::vector<uint8_t> bytes;
  for (const float value : Floats(name)) {
    if (status_.ok()) status_ = CheckWhole(name, value, UINT8_MAX);
    if (!status_.ok()) return {};
    bytes.push_back(static_cast<uint8_t>(value));
  }
  return bytes;
}

void CheckpointReader::FloatsInto(std::string_view name, std::span<float> out) {
  const std::vector<float> values = Floats(name);
  if (!status_.ok()) return;
  if (values.size() != out.size()) {
    status_ = Status(StatusCode::kDataLoss, fmt::format("{} has {} values, the learner's has {}",
                                                        name, values.size(), out.size()));
    return;
  }
  std::copy(values.begin(), values.end(), out.begin());
}

ArrayVisitor<float> CheckpointReader::Arrays(std::string prefix) {
  return [this, prefix = std::move(prefix)](const NamedArray<float>& array) {
    FloatsInto(Join(prefix, array.name), array.values);
  };
}

CounterVisitor CheckpointReader::Counters(std::string prefix) {
  return [this, prefix = std::move(prefix)](const NamedCounter& counter) {
    const int64_t value = Integer(Join(prefix, counter.name));
    if (status_.ok()) *counter.value = value;
  };
}

std::string CheckpointPath(const std::string& folder, uint64_t update) {
  return fmt::format("{}/{}{}{}", folder, kPrefix, update, kSuffix);
}

Result<std::vector<uint64_t>> ListCheckpoints(const std::string& folder) {
  std::vector<uint64_t> updates;
  std::error_code error;
  std::filesystem::directory_iterator entry(folder, error);
  for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
    std::string name = entry->path().filename().string();
    if (!name.starts_with(kPrefix) || !name.ends_with(kSuffix)) continue;
    name = name.substr(kPrefix.size(), name.size() - kPrefix.size() - kSuffix.size());
    const auto update = ParseUnsigned("checkpoint", name, 0, UINT64_MAX);
    if (update.ok()) updates.push_back(*update);
  }
  if (error && error != std::errc::no_such_file_or_directory) {
    return Status(StatusCode::kIoError, fmt::format("cannot read {}: {}", folder, error.message()));
  }
  std::sort(updates.rbegin(), updates.rend());
  return updates;
}

void RemoveOldCheckpoints(const std::string& folder) {
  constexpr size_t kKept = 2;
  const auto updates = ListCheckpoints(folder);
  if (!updates.ok()) return;
  for (size_t i = kKept; i < updates->size(); ++i) {
    std::error_code ignored;
    std::filesystem::remove(CheckpointPath(folder, (*updates)[i]), ignored);
  }
}

void SetAsideCheckpointsAfter(uint64_t update, const std::string& folder) {
  const auto updates = ListCheckpoints(folder);
  if (!updates.ok()) return;
  for (const uint64_t later : *updates) {
    if (later <= update) break;
    const std::filesystem::path path = CheckpointPath(folder, later);
    std::error_code ignored;
    std::filesystem::rename(path, path.parent_path() / ("unreadable-" + path.filename().string()),
                            ignored);
  }
}

}  // namespace b4mrl
