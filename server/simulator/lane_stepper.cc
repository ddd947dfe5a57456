#include "server/simulator/lane_stepper.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "proto/base/finite.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

DrawContext ContextOf(const LaneHeader& header) {
  return {DrawContext::Kind::kEpisode, header.lane_seed, header.episode, header.elapsed_steps};
}

uint64_t Absorb(uint64_t digest, std::span<const double> numbers) {
  return XXH3_64bits_withSeed(numbers.data(), numbers.size_bytes(), digest);
}

void AbsorbOutcome(LaneRecord record) {
  LaneHeader& header = record.header();
  header.digest = Absorb(header.digest, record.observation());
  const std::array<double, 4> outcome = {header.reward, double(header.terminated),
                                         double(header.truncated), double(header.cause)};
  header.digest = Absorb(header.digest, outcome);
}

// Whether replies can carry what the lane shows: observations as float32 whatever the session's
// dtype is, so that no result depends on it, and infos, which are always float64.
bool IsReportable(LaneRecord record) {
  return AllFitFloat32(record.observation()) && AllFinite(record.infos());
}

void CopyRecord(ConstLaneRecord from, LaneRecord to) {
  std::memcpy(to.bytes().data(), from.bytes().data(), from.bytes().size());
}

// Copies all parts of a record but the state, which the caller writes.
void CopyAllButState(ConstLaneRecord from, LaneRecord to) {
  to.header() = from.header();
  const size_t rest = sizeof(LaneHeader) + from.state().size_bytes();
  std::memcpy(to.bytes().data() + rest, from.bytes().data() + rest, from.bytes().size() - rest);
}

void ClearOutcome(LaneHeader& header) {
  header.terminated = 0;
  header.truncated = 0;
  header.cause = Cause::kNone;
  header.episode_ended = 0;
  header.reward = 0;
}

}  // namespace

Result<LaneStepper> LaneStepper::Create(std::shared_ptr<const Simulator> simulator,
                                        AutoresetMode mode, StartCheck check) {
  const EnvironmentSpec& spec = simulator->spec();
  const LaneLayout layout = {simulator->state_size(), simulator->perturbation_state_size(),
                             spec.observation.size(), spec.info_names.size()};
  if (layout.bytes() > limits::kLaneBufferBytes) {
    const std::string numbers = fmt::format(
        "bytes of a lane whose observation has {} numbers ({}), whose simulator's state has {} and "
        "whose perturbations remember {}",
        spec.observation.size(), fmt::join(spec.observation.shape, " x "), simulator->state_size(),
        simulator->perturbation_state_size());
    return InvalidNumber(numbers, static_cast<double>(layout.bytes()),
                         fmt::format("at most {}", limits::kLaneBufferBytes));
  }
  if (check == StartCheck::kDone) B4MRL_RETURN_IF_ERROR(simulator->CheckStart());
  return LaneStepper(std::move(simulator), mode, layout);
}

void LaneStepper::Initialize(uint64_t lane_seed, LaneRecord record) const {
  std::memset(record.bytes().data(), 0, record.bytes().size());
  record.header() = LaneHeader{.lane_seed = lane_seed};
}

void LaneStepper::Observe(const Environment& environment, LaneRecord record) const {
  environment.Observe(record.observation());
  const std::span<const double> parameters = environment.parameters();
  const size_t own_infos = record.infos().size() - parameters.size();
  environment.Infos(record.infos().first(own_infos));
  std::ranges::copy(parameters, record.infos().begin() + static_cast<ptrdiff_t>(own_infos));
  simulator_->perturbations().OnObservation(ContextOf(record.header()), record.perturbation_state(),
                                            record.observation());
}

Status LaneStepper::TryStart(Environment& environment, LaneRecord record) const {
  LaneHeader& header = record.header();
  B4MRL_RETURN_IF_ERROR(simulator_->EnterEpisode(environment, header.lane_seed, header.episode));
  B4MRL_RETURN_IF_ERROR(environment.StartEpisode(header.lane_seed, header.episode));
  environment.SaveState(record.state());
  std::ranges::fill(record.perturbation_state(), 0);
  header.elapsed_steps = 0;
  header.episode_return = 0;
  header.phase = LanePhase::kRunning;
  Observe(environment, record);
  if (IsReportable(record)) return Status();
  return Status(StatusCode::kInternal, "a start observation is not finite");
}

Status LaneStepper::StartEpisode(Environment& environment, LaneRecord record) const {
  constexpr int kMaxStarts = 8;
  Status status = TryStart(environment, record);
  for (int i = 1; i < kMaxStarts && !status.ok(); ++i) {
    ++record.header().episode;
    status = TryStart(environment, record);
  }
  return status;
}

Status LaneStepper::Reset(Environment& environment, ConstLaneRecord before,
                          std::optional<uint64_t> seed, LaneRecord after) const {
  CopyRecord(before, after);
  LaneHeader& header = after.header();
  ClearOutcome(header);
  if (seed.has_value()) {
    header.lane_seed = *seed;
    header.episode = 0;
    header.digest = 0;
  } else if (header.phase != LanePhase::kFresh) {
    ++header.episode;
  }
  B4MRL_RETURN_IF_ERROR(StartEpisode(environment, after));
  AbsorbOutcome(after);
  return Status();
}

Status LaneStepper::CheckStep(ConstLaneRecord before, std::span<const double> action) const {
  if (before.header().phase == LanePhase::kFresh) {
    return Status(StatusCode::kFailedPrecondition, "the lane was never reset");
  }
  const std::vector<DimensionSpec>& dimensions = spec().action.dimensions;
  if (action.size() != dimensions.size()) {
    return InvalidArgument("length of an action", std::to_string(action.size()),
                           std::to_string(dimensions.size()));
  }
  for (size_t i = 0; i < action.size(); ++i) {
    if (!std::isfinite(action[i])) {
      return InvalidNumber(fmt::format("action[{}] ({})", i, dimensions[i].name), action[i],
                           "finite numbers");
    }
  }
  return Status();
}

// Ends the episode of `record`, whose outcome flags are set, and begins the next one if the mode
// wants it.
Status LaneStepper::Finish(Environment& environment, LaneRecord record) const {
  LaneHeader& header = record.header();
  header.episode_ended = 1;
  header.final_return = header.episode_return;
  header.final_length = header.elapsed_steps;
  std::ranges::copy(record.observation(), record.final_observation().begin());
  std::ranges::copy(record.infos(), record.final_infos().begin());
  header.phase = LanePhase::kEnded;
  if (mode_ != AutoresetMode::kSameStep) return Status();
  header.digest = Absorb(header.digest, record.final_observation());
  ++header.episode;
  return StartEpisode(environment, record);
}

Status LaneStepper::Step(Environment& environment, ConstLaneRecord before,
                         std::span<const double> action, LaneRecord after,
                         ActionPrecision precision) const {
  B4MRL_RETURN_IF_ERROR(CheckStep(before, action));
  // In mode SAME_STEP a lane stands at an end only when it was restored from another mode's state.
  if (before.header().phase == LanePhase::kEnded && mode_ != AutoresetMode::kDisabled) {
    return Reset(environment, before, std::nullopt, after);
  }
  CopyAllButState(before, after);
  LaneHeader& header = after.header();
  ClearOutcome(header);
  header.digest = Absorb(header.digest, action);

  std::array<double, limits::kMaxActionDimensions> changed;
  const std::span<double> perturbed_action = std::span(changed).first(action.size());
  std::ranges::copy(action, perturbed_action.begin());
  simulator_->perturbations().OnAction(ContextOf(header), after.perturbation_state(),
                                       perturbed_action);
  B4MRL_RETURN_IF_ERROR(simulator_->EnterEpisode(environment, header.lane_seed, header.episode));
  environment.LoadState(before.state());
  const bool is_float32 =
      precision == ActionPrecision::kFloat32 && simulator_->perturbations().keeps_float32();
  StepResult result =
      is_float32 ? environment.StepFloat32(perturbed_action) : environment.Step(perturbed_action);
  ++header.elapsed_steps;

  const bool simulated = result.cause != Cause::kNumericalError;
  if (simulated) {
    simulator_->perturbations().OnReward(ContextOf(header), after.perturbation_state(),
                                         result.reward);
    Observe(environment, after);
  }
  const double new_return = header.episode_return + result.reward;
  if (simulated && IsReportable(after) && std::isfinite(new_return)) {
    environment.SaveState(after.state());
    header.reward = result.reward;
    header.episode_return = new_return;
    header.terminated = result.terminated;
    header.truncated = environment.TimeIsOver(header.elapsed_steps);
    header.cause = result.terminated  ? Cause::kUnhealthy
                   : header.truncated ? Cause::kLimit
                                      : Cause::kNone;
  } else {
    std::ranges::copy(before.state(), after.state().begin());
    std::ranges::copy(before.observation(), after.observation().begin());
    std::ranges::copy(before.infos(), after.infos().begin());
    header.truncated = 1;
    header.cause = Cause::kNumericalError;
  }
  if (header.terminated || header.truncated) {
    B4MRL_RETURN_IF_ERROR(Finish(environment, after));
  }
  AbsorbOutcome(after);
  return Status();
}

Status LaneStepper::TruncateAfterCrash(Environment& environment, ConstLaneRecord before,
                                       LaneRecord after) const {
  CopyRecord(before, after);
  LaneHeader& header = after.header();
  ClearOutcome(header);
  header.truncated = 1;
  header.cause = Cause::kCrash;
  if (header.phase == LanePhase::kRunning || mode_ == AutoresetMode::kDisabled) {
    ++header.elapsed_steps;
  } else {
    // The step that crashed was to start the next episode. A reset must not draw this start again.
    ++header.episode;
    header.elapsed_steps = 0;
    header.episode_return = 0;
  }
  B4MRL_RETURN_IF_ERROR(Finish(environment, after));
  AbsorbOutcome(after);
  return Status();
}

NamedState LaneStepper::GetNamedState(Environment& environment, ConstLaneRecord before) const {
  environment.LoadState(before.state());
  return environment.GetNamedState();
}

Status LaneStepper::SetNamedState(Environment& environment, ConstLaneRecord before,
                                  const NamedState& state, LaneRecord after) const {
  CopyRecord(before, after);
  LaneHeader& header = after.header();
  ClearOutcome(header);
  if (header.phase != LanePhase::kRunning) {
    if (header.phase == LanePhase::kEnded) ++header.episode;  // the ended one's noise is drawn
    header.phase = LanePhase::kRunning;
    header.elapsed_steps = 0;
    header.episode_return = 0;
    std::ranges::fill(after.perturbation_state(), 0);
  }
  B4MRL_RETURN_IF_ERROR(simulator_->EnterEpisode(environment, header.lane_seed, header.episode));
  B4MRL_RETURN_IF_ERROR(environment.SetNamedState(state));
  environment.SaveState(after.state());
  Observe(environment, after);
  if (!IsReportable(after) || !AllFinite(after.state())) {
    return Status(StatusCode::kInvalidArgument,
                  "the state, or its observation, has parts that are not finite");
  }
  AbsorbOutcome(after);
  return Status();
}

}  // namespace b4mrl
