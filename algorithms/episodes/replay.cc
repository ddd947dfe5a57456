#include "algorithms/episodes/replay.h"

#include <fmt/format.h>

#include <array>
#include <cstring>
#include <span>
#include <utility>
#include <vector>

#include "algorithms/base/learner.h"
#include "algorithms/base/replay_file.h"
#include "client/remote_environment.h"
#include "data/d4rl/dataset_file_reader.h"
#include "data/files/file_hash.h"
#include "proto/wire/tensor_rows.h"

namespace b4mrl {
namespace {

constexpr size_t kBlockRows = 4096;  // that are kept before they are appended

// The SHA-256 of a replay.bin (base/replay_file.h).
class ReplayHash {
 public:
  ReplayHash(uint32_t observation_size, uint32_t action_size) {
    const ReplayHeader header{.observation_size = observation_size, .action_size = action_size};
    std::array<std::byte, kReplayHeaderBytes> bytes{};
    std::memcpy(bytes.data(), &header, sizeof(header));
    hash_.Update(bytes);
  }
  void Add(std::span<const float> numbers) { hash_.Update(std::as_bytes(numbers)); }
  std::string Hex() { return hash_.Hex(); }

 private:
  Sha256 hash_;
};

void Extend(std::vector<float>& out, std::span<const float> values) {
  out.insert(out.end(), values.begin(), values.end());
}

class Replayer {
 public:
  Replayer(const ActionLog& log, uint64_t rows, RemoteEnvironment session, Recorder& recorder)
      : log_(log),
        session_(std::move(session)),
        recorder_(recorder),
        rows_(rows),
        hash_(static_cast<uint32_t>(session_.spec().observation.size()), log.action_size),
        action_scale_(session_.spec().ActionScale()),
        scaled_(log.action_size) {}

  Result<uint64_t> Run(Progress& progress);

 private:
  Status Step(uint64_t row);
  void Keep(std::span<const float> next, float reward, bool terminated, bool timed_out);
  Status Flush();

  const ActionLog& log_;
  RemoteEnvironment session_;
  Recorder& recorder_;
  uint64_t rows_;  // to append
  ReplayHash hash_;
  std::vector<float> action_scale_;
  std::vector<float> scaled_;  // the action in the environment's units
  std::vector<float> observation_;
  DatasetBlock block_;
  uint64_t episode_ = 0;
  uint64_t first_episode_ = 0;  // of those to append
  uint64_t kept_ = 0;           // rows since the start of first_episode_, at most rows_
};

Result<uint64_t> Replayer::Run(Progress& progress) {
  progress.Start("step the log's actions", "rows", log_.rows);
  const std::array<uint64_t, 1> seeds = {TrainLaneSeed(log_.seed, 0)};
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome first, session_.Reset({}, seeds));
  Extend(observation_, RowOf(first.observations, 0));
  for (uint64_t row = 0; row < log_.rows; ++row) {
    B4MRL_RETURN_IF_ERROR(Step(row));
    if (row % kBlockRows == 0) progress.Update(row);
  }
  B4MRL_RETURN_IF_ERROR(Flush());
  progress.Update(log_.rows);
  progress.Finish();
  if (const std::string sha256 = hash_.Hex(); sha256 != log_.replay_sha256) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("the stepped transitions have the SHA-256 {}, those of the run {}",
                              sha256, log_.replay_sha256));
  }
  return first_episode_;
}

Status Replayer::Step(uint64_t row) {
  const std::span<const float> action =
      std::span(log_.actions).subspan(row * log_.action_size, log_.action_size);
  for (size_t i = 0; i < action.size(); ++i) {
    scaled_[i] = action[i] * action_scale_[i];
  }
  B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome, session_.Step(scaled_));
  if (outcome.given_up(0)) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the simulator gave up the step of row {}", row));
  }
  const bool ended = !outcome.final_lanes.empty();
  const std::span<const float> next =
      ended ? RowOf(outcome.final_observations, 0) : RowOf(outcome.observations, 0);
  const auto reward = static_cast<float>(outcome.rewards[0]);
  const bool terminated = outcome.terminated[0] != 0;
  hash_.Add(observation_);
  hash_.Add(action);
  hash_.Add(next);
  hash_.Add(std::array{reward, terminated ? 0.0f : 1.0f});
  if (kept_ < rows_) Keep(next, reward, terminated, outcome.timed_out(0));
  const std::span<const float> shown = RowOf(outcome.observations, 0);
  observation_.assign(shown.begin(), shown.end());
  const uint64_t latest_start = log_.rows - rows_;  // after which too few rows are left
  if (ended) {
    ++episode_;
    if (row + 1 <= latest_start) {
      block_ = DatasetBlock();
      kept_ = 0;
      first_episode_ = episode_;
    }
  }
  // Until then a later episode may be the first, so what is kept, one episode at most, waits.
  return row < latest_start || block_.rewards.size() < kBlockRows ? Status() : Flush();
}

void Replayer::Keep(std::span<const float> next, float reward, bool terminated, bool timed_out) {
  Extend(block_.observations, observation_);
  Extend(block_.actions, scaled_);
  Extend(block_.next_observations, next);
  block_.rewards.push_back(reward);
  block_.terminals.push_back(terminated ? 1 : 0);
  block_.timeouts.push_back(timed_out ? 1 : 0);
  ++kept_;
}

Status Replayer::Flush() {
  if (block_.rewards.empty()) return Status();
  B4MRL_RETURN_IF_ERROR(recorder_.Append(block_.view()));
  block_ = DatasetBlock();
  return Status();
}

}  // namespace

Result<uint64_t> ReplayActions(const ActionLog& log, uint64_t rows, Client& client,
                               Recorder& recorder, Progress& progress) {
  if (rows == 0 || rows > log.rows) {
    return InvalidNumber("rows", rows, fmt::format("1..{}, which the action log has", log.rows));
  }
  EnvironmentOptions options;
  B4MRL_ASSIGN_OR_RETURN(options.simulator, ParseNamedArguments(log.simulator));
  options.seed = log.seed;
  options.autoreset_mode = AutoresetMode::kSameStep;
  options.deadline_ms = kLearnerDeadlineMs;
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment session, client.Make(log.environment, options));
  if (session.spec().action.size() != log.action_size) {
    return InvalidNumber("action size of the action log", log.action_size,
                         fmt::format("{}", session.spec().action.size()));
  }
  return Replayer(log, rows, std::move(session), recorder).Run(progress);
}

}  // namespace b4mrl
