#include "data/csv/dataset_csv_writer.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <utility>

namespace b4mrl {
namespace {

constexpr size_t kBlockBytes = 1 << 20;  // text that is written at once
constexpr int kExactDigits = 9;          // significant digits that tell all float32 apart

void AddNumber(float value, std::string* text) {
  std::array<char, 32> digits{};
  if (std::isnan(value)) {  // never "-nan", which not every reader knows
    *text += "nan";
    return;
  }
  char* end = std::to_chars(digits.begin(), digits.end(), value).ptr;
  // The shortest text may lie so near to the middle between two float32 that its float64 is the
  // middle, and rounding that goes to the other one.
  double read = 0;
  std::from_chars(digits.begin(), end, read);
  if (static_cast<float>(read) != value) {
    end =
        std::to_chars(digits.begin(), digits.end(), value, std::chars_format::general, kExactDigits)
            .ptr;
  }
  text->append(digits.begin(), end);
}

}  // namespace

DatasetCsvWriter::DatasetCsvWriter(AtomicFile file, uint32_t observation_size, uint32_t action_size)
    : file_(std::move(file)), observation_size_(observation_size), action_size_(action_size) {}

Result<DatasetCsvWriter> DatasetCsvWriter::Create(const std::string& path,
                                                  uint32_t observation_size, uint32_t action_size) {
  B4MRL_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
  std::string header;
  const auto add = [&header](std::string_view name, uint32_t count) {
    for (uint32_t i = 0; i < count; ++i) header += fmt::format("{}_{},", name, i);
  };
  add("observation", observation_size);
  add("action", action_size);
  header += "reward,";
  add("next_observation", observation_size);
  header += "terminal,timeout\n";
  B4MRL_RETURN_IF_ERROR(file.Write(header));
  return DatasetCsvWriter(std::move(file), observation_size, action_size);
}

Status DatasetCsvWriter::Append(const DatasetRows& rows) {
  const size_t observations = rows.rows * observation_size_;
  if (rows.observations.size() != observations || rows.next_observations.size() != observations ||
      rows.actions.size() != rows.rows * action_size_ || rows.rewards.size() != rows.rows ||
      rows.terminals.size() != rows.rows || rows.timeouts.size() != rows.rows) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the arrays have not {} rows of {} observation and {} action values",
                              rows.rows, observation_size_, action_size_));
  }
  const auto add = [this](std::span<const float> values) {
    for (const float value : values) {
      AddNumber(value, &text_);
      text_ += ',';
    }
  };
  for (size_t row = 0; row < rows.rows; ++row) {
    add(rows.observations.subspan(row * observation_size_, observation_size_));
    add(rows.actions.subspan(row * action_size_, action_size_));
    add(rows.rewards.subspan(row, 1));
    add(rows.next_observations.subspan(row * observation_size_, observation_size_));
    text_ += rows.terminals[row] != 0 ? "1," : "0,";
    text_ += rows.timeouts[row] != 0 ? "1\n" : "0\n";
    if (text_.size() < kBlockBytes && row + 1 < rows.rows) continue;
    B4MRL_RETURN_IF_ERROR(file_.Write(text_));
    text_.clear();
  }
  return Status();
}

Status DatasetCsvWriter::Commit(Existing existing) { return file_.Commit(existing); }

}  // namespace b4mrl
