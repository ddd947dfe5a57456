#include "data/d4rl/import_dataset.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <vector>

#include "data/columns/dataset_builder.h"
#include "data/columns/episodes.h"
#include "data/columns/statistics.h"
#include "data/hdf5/hdf5_file.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

// Largest memory of a block of rows, in bytes; blocks follow the chunks of the widest column.
constexpr uint64_t kMaxBlockBytes = 128ull << 20;

// The file's columns, checked against each other.
struct SourceColumns {
  Hdf5Column observations, actions, rewards;
  std::optional<Hdf5Column> next_observations;
  std::vector<uint8_t> terminals, timeouts;
  uint64_t rows = 0;
  uint32_t observation_size = 0;
  uint32_t action_size = 0;
  std::vector<uint32_t> hidden;  // dimensions of observations that must be 0
};

// Memory for one block of rows, and the views of that memory.
struct Block {
  std::vector<float> observations, actions, rewards, next_observations;
  uint64_t first_row = 0;

  uint64_t rows() const { return rewards.size(); }
  TransitionColumns View(const SourceColumns& source) const {
    return {.rows = rows(),
            .observation_size = source.observation_size,
            .action_size = source.action_size,
            .observations = observations,
            .actions = actions,
            .rewards = rewards,
            .next_observations = next_observations,
            .terminals = std::span(source.terminals).subspan(first_row, rows()),
            .timeouts = std::span(source.timeouts).subspan(first_row, rows())};
  }
};

Status CheckShape(const Hdf5Column& column, uint64_t rows, std::optional<uint64_t> width) {
  if (column.rows() != rows) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("dataset '{}' has {} rows where 'observations' has {}", column.path(),
                              column.rows(), rows));
  }
  const size_t rank = column.shape().size();
  const bool fits = width ? (rank == 2 || *width == 1) && column.width() == *width : rank == 2;
  if (fits && rank >= 1) return Status();
  return Status(StatusCode::kInvalidArgument,
                fmt::format("dataset '{}' has {} dimensions and {} elements a row, allowed: {}",
                            column.path(), rank, column.width(),
                            width ? fmt::format("{} a row", *width) : "2 dimensions"));
}

Result<Hdf5Column> OpenFloats(const Hdf5Reader& file, std::string_view name) {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column column, file.OpenColumn(name));
  if (column.type() == Hdf5Type::kFloat32 || column.type() == Hdf5Type::kFloat64) return column;
  return Status(StatusCode::kInvalidArgument,
                fmt::format("dataset '{}' is {}, allowed: float32, float64", name,
                            Hdf5TypeName(column.type())));
}

Status ReadFlags(const Hdf5Reader& file, std::string_view name, uint64_t rows,
                 std::vector<uint8_t>* flags) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column column, file.OpenColumn(name));
  B4MRL_RETURN_IF_ERROR(CheckShape(column, rows, 1));
  flags->resize(rows);
  for (uint64_t first = 0; first < rows; first += column.block_rows()) {
    const uint64_t count = std::min(column.block_rows(), rows - first);
    B4MRL_RETURN_IF_ERROR(column.ReadFlags(first, std::span(*flags).subspan(first, count)));
  }
  return Status();
}

Result<SourceColumns> OpenSource(const Hdf5Reader& file) {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column observations, OpenFloats(file, "observations"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column actions, OpenFloats(file, "actions"));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column rewards, OpenFloats(file, "rewards"));
  const uint64_t rows = observations.rows();
  const uint64_t width = observations.width();
  B4MRL_RETURN_IF_ERROR(CheckShape(observations, rows, std::nullopt));
  B4MRL_RETURN_IF_ERROR(CheckShape(actions, rows, std::nullopt));
  B4MRL_RETURN_IF_ERROR(CheckShape(rewards, rows, 1));
  if (rows == 0 || width == 0 || actions.width() == 0) {
    return Status(StatusCode::kInvalidArgument, "'observations' or 'actions' is empty");
  }
  if (actions.width() > limits::kMaxActionDimensions) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("dataset 'actions' has {} elements a row, allowed: 1..{}",
                              actions.width(), limits::kMaxActionDimensions));
  }
  SourceColumns source{
      std::move(observations), std::move(actions), std::move(rewards), {}, {}, {}, rows};
  source.observation_size = static_cast<uint32_t>(width);
  source.action_size = static_cast<uint32_t>(source.actions.width());
  if (file.Exists("next_observations")) {
    B4MRL_ASSIGN_OR_RETURN(source.next_observations, OpenFloats(file, "next_observations"));
    B4MRL_RETURN_IF_ERROR(CheckShape(*source.next_observations, rows, width));
  }
  B4MRL_RETURN_IF_ERROR(ReadFlags(file, "terminals", rows, &source.terminals));
  if (file.Exists("timeouts")) {
    B4MRL_RETURN_IF_ERROR(ReadFlags(file, "timeouts", rows, &source.timeouts));
  } else {
    source.timeouts = InferTimeouts(source.terminals, kD4rlStepLimit);
  }
  return source;
}

// Floats in a row: observation, next observation, action and reward.
uint64_t RowFloats(const SourceColumns& source) {
  return 2ull * source.observation_size + source.action_size + 1;
}

uint64_t BlockRows(const SourceColumns& source) {
  const uint64_t row_bytes = RowFloats(source) * sizeof(float);
  const uint64_t most = std::max<uint64_t>(kMaxBlockBytes / row_bytes, 1);
  return std::min({source.observations.block_rows(), most, source.rows});
}

// Refuses rows of the array `name` that show a dimension of `hidden`, which learners are told is 0.
Status CheckHides(std::span<const uint32_t> hidden, std::string_view name, uint64_t first_row,
                  size_t width, std::span<const float> values) {
  if (hidden.empty()) return Status();
  for (size_t row = 0; row < values.size() / width; ++row) {
    for (const uint32_t dimension : hidden) {
      const float value = values[row * width + dimension];
      if (value == 0) continue;
      const std::string where =
          fmt::format("dimension {} in row {} of '{}'", dimension, first_row + row, name);
      return InvalidNumber(where, value, "0, because metadata/recording/hidden has it");
    }
  }
  return Status();
}

Result<Block> ReadBlock(const SourceColumns& source, uint64_t first_row, uint64_t rows) {
  Block block;
  block.first_row = first_row;
  block.observations.resize(rows * source.observation_size);
  block.actions.resize(rows * source.action_size);
  block.rewards.resize(rows);
  B4MRL_RETURN_IF_ERROR(source.observations.Read(first_row, block.observations));
  B4MRL_RETURN_IF_ERROR(source.actions.Read(first_row, block.actions));
  B4MRL_RETURN_IF_ERROR(source.rewards.Read(first_row, block.rewards));
  if (source.next_observations) {
    block.next_observations.resize(rows * source.observation_size);
    B4MRL_RETURN_IF_ERROR(source.next_observations->Read(first_row, block.next_observations));
  }
  const size_t width = source.observation_size;
  B4MRL_RETURN_IF_ERROR(
      CheckHides(source.hidden, "observations", first_row, width, block.observations));
  B4MRL_RETURN_IF_ERROR(
      CheckHides(source.hidden, "next_observations", first_row, width, block.next_observations));
  return block;
}

Status CopyStored(const SourceColumns& source, DatasetBuilder* builder) {
  const uint64_t step = BlockRows(source);
  for (uint64_t first = 0; first < source.rows; first += step) {
    B4MRL_ASSIGN_OR_RETURN(const Block block,
                           ReadBlock(source, first, std::min(step, source.rows - first)));
    B4MRL_RETURN_IF_ERROR(builder->Append(block.View(source)));
  }
  return Status();
}

// Appends each block after the next one was read, because the last row of a block needs the first
// observation of the next block.
Status CopyD4rl(const SourceColumns& source, DatasetBuilder* builder) {
  const uint64_t step = BlockRows(source);
  StatisticsAccumulator returns(0);  // of all rows of the file
  Block block;
  for (uint64_t first = 0; first < source.rows + step; first += step) {
    Block next;
    if (first < source.rows) {
      B4MRL_ASSIGN_OR_RETURN(next, ReadBlock(source, first, std::min(step, source.rows - first)));
    }
    if (block.rows() > 0) {
      const std::span<const float> following =
          std::span(next.observations)
              .first(std::min<size_t>(source.observation_size, next.observations.size()));
      const TransitionColumns view = block.View(source);
      B4MRL_RETURN_IF_ERROR(
          builder->AppendD4rl(view, block.first_row, source.terminals, source.timeouts, following));
      returns.AddRewards(view.rewards, view.terminals, view.timeouts);
    }
    block = std::move(next);
  }
  builder->SetReturns(returns.Finish());
  return Status();
}

// The behaviour policy in words; "" if the file does not name it.
std::string BehaviourPolicy(const Hdf5Reader& file, const DatasetProvenance& provenance) {
  std::string policies;
  for (const RecordedPart& part : provenance.parts) {
    policies += (policies.empty() ? "" : "; ") + part.policy;
  }
  if (!policies.empty()) return policies;
  const Result<std::string> given = file.ReadText("metadata/behaviour_policy");
  if (given.ok()) return *given;
  const Result<std::string> algorithm = file.ReadText("metadata/algorithm");
  if (!algorithm.ok()) return "";
  const Result<double> iteration = file.ReadNumber("metadata/iteration");
  return iteration.ok() ? fmt::format("{}, iteration {:.0f}", *algorithm, *iteration) : *algorithm;
}

}  // namespace

Result<ImportedDataset> ImportDataset(const std::string& file_path, const std::string& cache_folder,
                                      uint64_t max_cache_bytes) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader file, Hdf5Reader::Open(file_path));
  B4MRL_ASSIGN_OR_RETURN(SourceColumns source, OpenSource(file));
  ImportedDataset imported;
  B4MRL_ASSIGN_OR_RETURN(imported.provenance, ReadDatasetProvenance(file));
  B4MRL_RETURN_IF_ERROR(imported.provenance.CheckHidden(source.observation_size));
  source.hidden = imported.provenance.hidden_dimensions;
  imported.behaviour_policy = BehaviourPolicy(file, imported.provenance);
  const uint64_t bytes = source.rows * (RowFloats(source) * sizeof(float) + 2);  // 2: two flags
  if (bytes > max_cache_bytes) {
    return Status(StatusCode::kLimitExceeded,
                  fmt::format("{} takes {} bytes when it is served, allowed: {}", file_path, bytes,
                              max_cache_bytes));
  }
  B4MRL_ASSIGN_OR_RETURN(
      DatasetBuilder builder,
      DatasetBuilder::Create(cache_folder, source.observation_size, source.action_size));
  imported.infers_timeouts = !file.Exists("timeouts");
  const bool stored = source.next_observations.has_value();
  B4MRL_RETURN_IF_ERROR(stored ? CopyStored(source, &builder) : CopyD4rl(source, &builder));
  const Result<std::string> said = file.ReadText("metadata/transitions");
  const bool follows_d4rl =
      !stored || (said.ok() && *said == TransitionRuleName(TransitionRule::kD4rl));
  builder.SetProperty(
      "transition_rule",
      TransitionRuleName(follows_d4rl ? TransitionRule::kD4rl : TransitionRule::kStored));
  B4MRL_RETURN_IF_ERROR(builder.Commit());
  imported.rows = builder.rows();
  return imported;
}

}  // namespace b4mrl
