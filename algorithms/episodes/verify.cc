#include "algorithms/episodes/verify.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <utility>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/episodes/collect.h"
#include "algorithms/episodes/replay.h"
#include "client/remote_environment.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

// Rows are read in blocks, which are cut after a whole episode: so many rows, or fewer if they
// would have more numbers.
constexpr uint64_t kRowsAtOnce = 131'072, kNumbersAtOnce = 32 << 20;
constexpr uint32_t kLanes = 128;
constexpr std::string_view kStage = "step again";  // for the progress

// The first number that differs in a bit.
std::optional<RowDifference> Compare(uint64_t row, std::string_view column,
                                     std::span<const float> stored,
                                     std::span<const float> stepped) {
  for (size_t i = 0; i < stored.size(); ++i) {
    if (std::bit_cast<uint32_t>(stored[i]) == std::bit_cast<uint32_t>(stepped[i])) continue;
    return RowDifference{row, fmt::format("{}[{}]", column, i), stored[i], stepped[i]};
  }
  return std::nullopt;
}

std::optional<RowDifference> CompareNumber(uint64_t row, std::string_view column, float stored,
                                           float stepped) {
  if (std::bit_cast<uint32_t>(stored) == std::bit_cast<uint32_t>(stepped)) return std::nullopt;
  return RowDifference{row, std::string(column), stored, stepped};
}

// One episode of a block: rows [row, end) of the block.
struct Episode {
  uint64_t number = 0;  // in its part of the file
  uint64_t row = 0;
  uint64_t end = 0;
};

// Verifies one part of a file: rows of one seed.
class PartVerifier {
 public:
  PartVerifier(const DatasetFileReader& file, const RecordedPart& part, RemoteEnvironment session,
               Progress& progress)
      : file_(file),
        part_(part),
        session_(std::move(session)),
        progress_(progress),
        lanes_(session_.num_envs()),
        next_number_(file.replay_first_episode().value_or(0)) {}

  // Verifies the rows [first_row, first_row + part.rows) of the file.
  Result<std::optional<RowDifference>> Run(uint64_t first_row);

 private:
  // The block's episodes, in order. A block that is not the part's last ends with its last whole
  // episode.
  std::vector<Episode> FindEpisodes(bool is_last);
  Status VerifyBlock(std::vector<Episode> episodes);
  Status Start(std::span<const uint32_t> lanes, std::vector<Episode>& waiting);
  Result<StepOutcome> ResetLanes(std::span<const uint32_t> lanes);
  // Starts the first episode of a replay's rows, which is as many resets away as there were
  // episodes before it.
  Result<StepOutcome> StartReplay();
  Status StepLanes(const std::vector<uint32_t>& busy);
  // Compares the row that a lane has stepped; returns whether the lane's episode goes on.
  bool CompareStep(Episode& lane, const StepOutcome& outcome, size_t position);
  void Note(std::optional<RowDifference> difference);
  std::span<const float> StoredRow(const std::vector<float>& column, uint64_t row) const {
    const size_t width = column.size() / block_.rewards.size();
    return std::span(column).subspan(row * width, width);
  }

  const DatasetFileReader& file_;
  const RecordedPart& part_;
  RemoteEnvironment session_;
  Progress& progress_;
  std::vector<Episode> lanes_;
  uint64_t next_number_;
  bool replay_started_ = false;
  DatasetBlock block_;
  uint64_t block_row_ = 0;  // the block's first row in the file
  std::optional<RowDifference> first_;
};

Result<std::optional<RowDifference>> PartVerifier::Run(uint64_t first_row) {
  const uint64_t end = first_row + part_.rows;
  const uint64_t row_numbers = file_.row_numbers();
  const uint64_t most = std::min(kRowsAtOnce, kNumbersAtOnce / row_numbers);
  for (block_row_ = first_row; block_row_ < end && !first_;) {
    const uint64_t count = std::min(most, end - block_row_);
    B4MRL_ASSIGN_OR_RETURN(block_, file_.Read(block_row_, count));
    std::vector<Episode> episodes = FindEpisodes(block_row_ + count == end);
    const uint64_t verified = episodes.back().end;
    B4MRL_RETURN_IF_ERROR(VerifyBlock(std::move(episodes)));
    block_row_ += verified;
    progress_.Update(block_row_);
  }
  return first_;
}

std::vector<Episode> PartVerifier::FindEpisodes(bool is_last) {
  std::vector<Episode> episodes;
  uint64_t first = 0;
  const uint64_t rows = block_.rewards.size();
  for (uint64_t row = 0; row < rows; ++row) {
    if (block_.terminals[row] == 0 && block_.timeouts[row] == 0) continue;
    episodes.push_back({next_number_++, first, row + 1});
    first = row + 1;
  }
  // The part's last episode may be cut. An episode longer than a block ends none of its rows; the
  // simulator, which ends episodes, will say so.
  if (first < rows && (is_last || episodes.empty())) {
    episodes.push_back({next_number_++, first, rows});
  }
  return episodes;
}

Status PartVerifier::VerifyBlock(std::vector<Episode> episodes) {
  std::reverse(episodes.begin(), episodes.end());  // the next one stands at the end
  std::vector<uint32_t> idle, busy;
  for (uint32_t lane = 0; lane < lanes_.size(); ++lane) {
    lanes_[lane] = Episode();
    idle.push_back(lane);
  }
  while (true) {
    B4MRL_RETURN_IF_ERROR(Start(idle, episodes));
    idle.clear();
    busy.clear();
    for (uint32_t lane = 0; lane < lanes_.size(); ++lane) {
      if (lanes_[lane].row < lanes_[lane].end) busy.push_back(lane);
    }
    if (busy.empty()) return Status();
    B4MRL_RETURN_IF_ERROR(StepLanes(busy));
    for (const uint32_t lane : busy) {
      if (lanes_[lane].row == lanes_[lane].end) idle.push_back(lane);
    }
  }
}

// Gives each of the lanes the next waiting episode, while there are any.
Status PartVerifier::Start(std::span<const uint32_t> lanes, std::vector<Episode>& waiting) {
  std::vector<uint32_t> started;
  for (const uint32_t lane : lanes) {
    if (waiting.empty()) break;
    lanes_[lane] = waiting.back();
    waiting.pop_back();
    started.push_back(lane);
  }
  if (started.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome reset, ResetLanes(started));
  for (size_t i = 0; i < started.size(); ++i) {
    Episode& lane = lanes_[started[i]];
    const std::span<const float> stored = StoredRow(block_.observations, lane.row);
    Note(Compare(block_row_ + lane.row, "observations", stored, RowOf(reset.observations, i)));
  }
  return Status();
}

Result<StepOutcome> PartVerifier::ResetLanes(std::span<const uint32_t> lanes) {
  if (!file_.replay_first_episode()) {
    std::vector<uint64_t> seeds;
    for (const uint32_t lane : lanes) seeds.push_back(EpisodeSeed(part_.seed, lanes_[lane].number));
    return session_.Reset(lanes, seeds);
  }
  // A run's one lane goes on from episode to episode; the file begins with one of them.
  return std::exchange(replay_started_, true) ? session_.Reset(lanes) : StartReplay();
}

Result<StepOutcome> PartVerifier::StartReplay() {
  const uint64_t earlier = *file_.replay_first_episode();
  const std::array<uint64_t, 1> seeds = {TrainLaneSeed(part_.seed, 0)};
  if (earlier > 0) progress_.Start("pass over earlier episodes", "episodes", earlier);
  B4MRL_ASSIGN_OR_RETURN(StepOutcome outcome, session_.Reset({}, seeds));
  for (uint64_t episode = 0; episode < earlier; ++episode) {
    B4MRL_ASSIGN_OR_RETURN(outcome, session_.Reset());
    progress_.Update(episode + 1);
  }
  progress_.Start(kStage, "rows", file_.rows());
  return outcome;
}

Status PartVerifier::StepLanes(const std::vector<uint32_t>& busy) {
  std::vector<float> actions;
  for (const uint32_t lane : busy) {
    const std::span<const float> action = StoredRow(block_.actions, lanes_[lane].row);
    actions.insert(actions.end(), action.begin(), action.end());
  }
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, session_.Step(actions, busy));
  for (size_t i = 0; i < busy.size(); ++i) {
    Episode& lane = lanes_[busy[i]];
    if (!CompareStep(lane, outcome, i)) lane.row = lane.end;
  }
  return Status();
}

bool PartVerifier::CompareStep(Episode& lane, const StepOutcome& outcome, size_t position) {
  const uint64_t at = lane.row++, row = block_row_ + at;
  const bool terminated = outcome.terminated[position] != 0;
  const bool timed_out = outcome.timed_out(position);
  const std::span<const float> next = RowOf(outcome.observations, position);
  std::optional<RowDifference> found =
      Compare(row, "next_observations", StoredRow(block_.next_observations, at), next);
  if (!found) {
    found = CompareNumber(row, "rewards", block_.rewards[at],
                          static_cast<float>(outcome.rewards[position]));
  }
  if (!found) found = CompareNumber(row, "terminals", block_.terminals[at], terminated ? 1 : 0);
  if (!found) {
    found = CompareNumber(row, "timeouts", block_.timeouts[at], timed_out ? 1 : 0);
  }
  if (!found && lane.row < lane.end) {
    found = Compare(row + 1, "observations", StoredRow(block_.observations, at + 1), next);
  }
  Note(found);
  return !found && !terminated && !timed_out;
}

void PartVerifier::Note(std::optional<RowDifference> difference) {
  if (difference && (!first_ || difference->row < first_->row)) first_ = std::move(difference);
}

// ---- files of others

// `rows[i]` is the row of `differences[i]`.
Deviation DeviationOf(std::vector<double> differences, const std::vector<uint64_t>& rows) {
  Deviation deviation;
  if (differences.empty()) return deviation;
  const auto largest = std::ranges::max_element(differences);
  deviation.largest = *largest;
  deviation.largest_row = rows[static_cast<size_t>(largest - differences.begin())];
  const auto quantile = [&](double share) {
    const auto at =
        static_cast<std::ptrdiff_t>(share * static_cast<double>(differences.size() - 1));
    std::ranges::nth_element(differences, differences.begin() + at);
    return differences[static_cast<size_t>(at)];
  };
  deviation.median = quantile(0.5);
  deviation.p99 = quantile(0.99);
  return deviation;
}

// Infinity if one of the numbers is NaN or infinite and the other is not the same.
double Distance(double stored, double stepped) {
  if (stored == stepped) return 0;
  const double distance = std::abs(stored - stepped);
  return std::isnan(distance) ? std::numeric_limits<double>::infinity() : distance;
}

double LargestDifference(std::span<const float> stored, std::span<const float> stepped) {
  double largest = 0;
  for (size_t i = 0; i < stored.size(); ++i) {
    largest = std::max(largest, Distance(stored[i], stepped[i]));
  }
  return largest;
}

// The file's rows as lanes of one session, a block of lanes at a time.
class StateComparer {
 public:
  StateComparer(const DatasetFileReader& file, RemoteEnvironment session)
      : file_(file), session_(std::move(session)) {}
  Result<StateComparison> Run(Progress& progress);

 private:
  Status CompareBlock(uint64_t first_row, uint64_t count);

  const DatasetFileReader& file_;
  RemoteEnvironment session_;
  std::vector<double> observations_, next_observations_, rewards_;
  std::vector<uint64_t> rows_;
};

Result<StateComparison> StateComparer::Run(Progress& progress) {
  progress.Start("step from the stored states", "rows", file_.rows());
  const uint64_t lanes = session_.num_envs();
  for (uint64_t row = 0; row < file_.rows(); row += lanes) {
    B4MRL_RETURN_IF_ERROR(CompareBlock(row, std::min(lanes, file_.rows() - row)));
    progress.Update(row);
  }
  progress.Update(file_.rows());
  progress.Finish();
  StateComparison out;
  out.rows = file_.rows();
  out.failed_rows = file_.rows() - rows_.size();
  out.observations = DeviationOf(std::move(observations_), rows_);
  out.next_observations = DeviationOf(std::move(next_observations_), rows_);
  out.rewards = DeviationOf(std::move(rewards_), rows_);
  return out;
}

Status StateComparer::CompareBlock(uint64_t first_row, uint64_t count) {
  B4MRL_ASSIGN_OR_RETURN(const DatasetBlock block, file_.Read(first_row, count));
  std::vector<uint32_t> lanes(count);
  for (uint32_t lane = 0; lane < count; ++lane) lanes[lane] = lane;
  LaneStates states;
  states.lanes = count;
  states.parts["time"].assign(count, 0);
  states.parts["qpos"] = block.qpos;
  states.parts["qvel"] = block.qvel;
  const auto restored = session_.Restore(states, lanes);
  if (!restored.ok()) {
    return restored.status().WithContext(
        fmt::format("states of the rows {} to {}, one a lane", first_row, first_row + count - 1));
  }
  const StepOutcome& set = *restored;
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome stepped, session_.Step(block.actions, lanes));
  const size_t width = file_.observation_size();
  for (size_t i = 0; i < count; ++i) {
    if (stepped.given_up(i)) continue;
    rows_.push_back(first_row + i);
    const auto stored = [&](const std::vector<float>& column) {
      return std::span(column).subspan(i * width, width);
    };
    observations_.push_back(
        LargestDifference(stored(block.observations), RowOf(set.observations, i)));
    next_observations_.push_back(
        LargestDifference(stored(block.next_observations), RowOf(stepped.observations, i)));
    rewards_.push_back(Distance(block.rewards[i], stepped.rewards[i]));
  }
  return Status();
}

Result<RemoteEnvironment> OpenFor(const DatasetFileReader& file, const std::string& environment,
                                  const std::string& simulator, uint32_t lanes, Client& client) {
  EnvironmentOptions options;
  B4MRL_ASSIGN_OR_RETURN(options.simulator, ParseNamedArguments(simulator));
  options.num_envs = lanes;
  options.seed = 0;
  options.autoreset_mode = AutoresetMode::kDisabled;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client.Make(environment, options));
  B4MRL_RETURN_IF_ERROR(
      session.spec().CheckSizes("the file", file.observation_size(), file.action_size()));
  return session;
}

}  // namespace

Result<std::optional<RowDifference>> VerifyRecording(const DatasetFileReader& file, Client& client,
                                                     Progress& progress) {
  const DatasetProvenance& provenance = file.provenance();
  uint64_t rows = 0;
  for (const RecordedPart& part : provenance.parts) rows += part.rows;
  if (rows != file.rows() || provenance.environment.empty()) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("the file names environment and seeds of {} of its {} rows", rows,
                              file.rows()));
  }
  const uint32_t lanes = file.replay_first_episode() ? 1 : kLanes;
  // A replay passes over earlier episodes first, whose progress is another one.
  if (!file.replay_first_episode()) progress.Start(kStage, "rows", file.rows());
  uint64_t first_row = 0;
  for (const RecordedPart& part : provenance.parts) {
    B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, OpenFor(file, provenance.environment,
                                                              provenance.simulator, lanes, client));
    PartVerifier verifier(file, part, std::move(session), progress);
    B4MRL_ASSIGN_OR_RETURN(const std::optional<RowDifference> difference, verifier.Run(first_row));
    if (difference) return difference;
    first_row += part.rows;
  }
  progress.Finish();
  return std::optional<RowDifference>();
}

Result<StateComparison> CompareStates(const DatasetFileReader& file, const std::string& environment,
                                      Client& client, Progress& progress) {
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, OpenFor(file, environment, "", kLanes, client));
  return StateComparer(file, std::move(session)).Run(progress);
}

}  // namespace b4mrl
