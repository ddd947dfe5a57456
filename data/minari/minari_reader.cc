#include "data/minari/minari_reader.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

constexpr uint64_t kMaxBlockBytes = 16 << 20;  // of a block's rows

}  // namespace

// Memory for consecutive rows of an episode. Observations have one row more than the rest, because
// the next observation of each row is the observation that follows it.
struct MinariReader::Block {
  std::vector<float> observations, actions, rewards;
  std::vector<uint8_t> terminals, timeouts;

  DatasetRows View(size_t observation_size) const {
    DatasetRows rows;
    rows.rows = rewards.size();
    rows.observations = std::span(observations).first(rewards.size() * observation_size);
    rows.next_observations = std::span(observations).subspan(observation_size);
    rows.actions = actions;
    rows.rewards = rewards;
    rows.terminals = terminals;
    rows.timeouts = timeouts;
    return rows;
  }
};

struct MinariReader::Episode {
  Hdf5Column observations, actions, rewards, terminations, truncations;

  uint64_t rows() const { return rewards.rows(); }
  Result<Block> Read(uint64_t first, uint64_t count) const {
    Block block;
    block.observations.resize((count + 1) * observations.width());
    block.actions.resize(count * actions.width());
    block.rewards.resize(count);
    block.terminals.resize(count);
    block.timeouts.resize(count);
    B4MRL_RETURN_IF_ERROR(observations.Read(first, block.observations));
    B4MRL_RETURN_IF_ERROR(actions.Read(first, block.actions));
    B4MRL_RETURN_IF_ERROR(rewards.Read(first, block.rewards));
    B4MRL_RETURN_IF_ERROR(terminations.ReadFlags(first, block.terminals));
    B4MRL_RETURN_IF_ERROR(truncations.ReadFlags(first, block.timeouts));
    return block;
  }
};

std::optional<std::string> FindMinariData(const std::string& path) {
  for (const std::string& folder : {path + "/data", path}) {
    std::error_code error;
    if (std::filesystem::is_regular_file(fmt::format("{}/{}", folder, kMinariMetadataFile),
                                         error)) {
      return folder;
    }
  }
  return std::nullopt;
}

MinariReader::MinariReader(Hdf5Reader file, ParsedMinariMetadata parsed)
    : file_(std::move(file)), parsed_(std::move(parsed)) {}

Result<MinariReader> MinariReader::Open(const std::string& data_folder) {
  const std::string metadata_file = fmt::format("{}/{}", data_folder, kMinariMetadataFile);
  B4MRL_ASSIGN_OR_RETURN(const std::string text,
                         ReadSmallFile(metadata_file, kMaxMinariMetadataBytes));
  B4MRL_ASSIGN_OR_RETURN(ParsedMinariMetadata parsed, ParseMinariMetadata(text));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Reader file,
                         Hdf5Reader::Open(fmt::format("{}/{}", data_folder, kMinariDataFile)));
  return MinariReader(std::move(file), std::move(parsed));
}

Result<Hdf5Column> MinariReader::OpenColumn(uint64_t episode, std::string_view name,
                                            uint64_t width) const {
  const std::string path = fmt::format("episode_{}/{}", episode, name);
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column column, file_.OpenColumn(path));
  const bool is_flag = name == "terminations" || name == "truncations";
  const bool is_float = column.type() == Hdf5Type::kFloat32 || column.type() == Hdf5Type::kFloat64;
  const bool may_be_whole = name == "rewards";  // as those of many environments are
  if (!is_flag && !is_float && !(may_be_whole && column.type() == Hdf5Type::kInteger)) {
    return InvalidArgument(fmt::format("type of '{}'", path), Hdf5TypeName(column.type()),
                           may_be_whole ? "float32, float64, integer" : "float32, float64");
  }
  if (column.shape().empty() || column.width() != width) {
    return InvalidNumber(fmt::format("elements in a row of '{}'", path), column.width(),
                         fmt::format("{}, as {} says", width, kMinariMetadataFile));
  }
  return column;
}

Result<MinariReader::Episode> MinariReader::OpenEpisode(uint64_t number) const {
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column observations,
                         OpenColumn(number, "observations", observation_size()));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column actions, OpenColumn(number, "actions", action_size()));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column rewards, OpenColumn(number, "rewards", 1));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column terminations, OpenColumn(number, "terminations", 1));
  B4MRL_ASSIGN_OR_RETURN(Hdf5Column truncations, OpenColumn(number, "truncations", 1));
  const uint64_t rows = rewards.rows();
  for (const Hdf5Column* column : {&actions, &terminations, &truncations}) {
    if (column->rows() == rows) continue;
    return InvalidNumber(fmt::format("rows of '{}'", column->path()), column->rows(),
                         fmt::format("{}, as '{}' has", rows, rewards.path()));
  }
  if (rows == 0 || observations.rows() != rows + 1) {
    return InvalidNumber(
        fmt::format("rows of '{}'", observations.path()), observations.rows(),
        fmt::format("1 more than the {} of '{}', which are at least 1", rows, rewards.path()));
  }
  return Episode{std::move(observations), std::move(actions), std::move(rewards),
                 std::move(terminations), std::move(truncations)};
}

// Sets the flags of an episode's last row as the rows' format has them; returns 1 if the episode is
// unfinished without its metadata saying so.
uint64_t MinariReader::EndEpisode(uint64_t number, Block* block) const {
  if (metadata().last_is_unfinished && number + 1 == metadata().episodes) {
    block->timeouts.back() = 0;  // as in the dataset that was exported
    return 0;
  }
  if (block->terminals.back() + block->timeouts.back() != 0) return 0;
  block->timeouts.back() = 1;
  return 1;
}

Status MinariReader::CopyTo(DatasetWriter& writer, uint64_t* unfinished,
                            const std::function<Status(uint64_t rows)>& go_on) const {
  // Observations, actions, the reward and the flags of a row.
  const uint64_t row_bytes = (observation_size() + action_size() + 2) * sizeof(float);
  const uint64_t block_rows = std::max<uint64_t>(kMaxBlockBytes / row_bytes, 1);
  constexpr uint64_t kRowsBetweenCalls = 8192;
  uint64_t called_at = 0;
  *unfinished = 0;
  for (uint64_t number = 0; number < metadata().episodes; ++number) {
    B4MRL_ASSIGN_OR_RETURN(const Episode episode, OpenEpisode(number));
    if (episode.rows() > metadata().rows - writer.rows()) break;  // refused below
    for (uint64_t first = 0; first < episode.rows(); first += block_rows) {
      const uint64_t count = std::min(block_rows, episode.rows() - first);
      B4MRL_ASSIGN_OR_RETURN(Block block, episode.Read(first, count));
      if (first + count == episode.rows()) *unfinished += EndEpisode(number, &block);
      B4MRL_RETURN_IF_ERROR(writer.Append(block.View(observation_size())));
      if (writer.rows() - called_at < kRowsBetweenCalls) continue;
      called_at = writer.rows();
      B4MRL_RETURN_IF_ERROR(go_on(called_at));
    }
  }
  if (writer.rows() == metadata().rows) return Status();
  return Status(StatusCode::kDataLoss,
                fmt::format("the {} episodes have not the {} steps that {} says",
                            metadata().episodes, metadata().rows, kMinariMetadataFile));
}

}  // namespace b4mrl
