#include "server/environments/mujoco/mujoco_environment.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "proto/base/finite.h"
#include "server/environments/canvas.h"
#include "server/environments/mujoco/mujoco_guard.h"

namespace b4mrl {
namespace {

// Greatest absolute value that MuJoCo accepts; beyond it MuJoCo resets its data (mjMAXVAL).
constexpr double kLargestValue = 1e10;

void CopyInto(std::span<const double> from, double* to) { std::copy(from.begin(), from.end(), to); }

// Parts that MuJoCo derives from others may be larger than what it accepts of these.
Status CheckPart(const std::string& name, std::span<const double> values, size_t size,
                 bool is_derived) {
  if (values.size() != size) {
    return InvalidArgument(fmt::format("length of state part '{}'", name),
                           std::to_string(values.size()), std::to_string(size));
  }
  for (size_t i = 0; i < size; ++i) {
    if (is_derived ? std::isfinite(values[i]) : std::abs(values[i]) <= kLargestValue) continue;
    return InvalidNumber(fmt::format("state {}[{}]", name, i), values[i],
                         is_derived ? "finite numbers" : "-1e10..1e10");
  }
  return Status();
}

// mj_forward normalises the quaternions of `positions`, which mj_step had already normalised when
// the state was read. Numbers that this changed by rounding alone get their `given` bits back, so
// that the next step has equal bits.
void KeepUnitQuaternions(std::span<const double> given, std::span<double> positions) {
  for (size_t i = 0; i < positions.size(); ++i) {
    if (std::abs(given[i] - positions[i]) < 1e-12) positions[i] = given[i];
  }
}

}  // namespace

MujocoEnvironment::MujocoEnvironment(MujocoScratch scratch, int frame_skip)
    : scratch_(std::move(scratch)),
      model_(scratch_.model()),
      data_(scratch_.data()),
      frame_skip_(frame_skip) {
  parts_ = {{"time", {&data_->time, 1}, false},
            {"qpos", qpos(), true},
            {"qvel", qvel(), true},
            {"qacc_warmstart", {data_->qacc_warmstart, qvel().size()}, false}};
}

void MujocoEnvironment::AddStatePart(const char* name, std::span<double> values) {
  parts_.push_back({name, values, false});
}

template <typename Function>
bool MujocoEnvironment::Guarded(Function function) {
  if (RunGuarded(function) && TakeWarnings(data_) == 0) return true;
  mj_resetData(&model_, data_);  // also frees the engine's stack after an error
  return false;
}

bool MujocoEnvironment::Simulate(std::span<const double> action) {
  CopyInto(action, data_->ctrl);
  return Guarded([this] {
    BeforeStep();
    for (int i = 0; i < frame_skip_; ++i) mj_step(&model_, data_);
    AfterStep();
  });
}

bool MujocoEnvironment::Forward() {
  return Guarded([this] {
    mj_forward(&model_, data_);
    AfterForward();
  });
}

StepResult MujocoEnvironment::Step(std::span<const double> action) {
  if (!Simulate(action)) return {.cause = Cause::kNumericalError};
  const StepResult result = Judge(action);
  if (!std::isfinite(result.reward)) return {.cause = Cause::kNumericalError};
  return result;
}

Status MujocoEnvironment::Reset(Rng& rng) {
  mj_resetData(&model_, data_);
  DrawInitialState(rng, qpos(), qvel());
  if (Forward()) return Status();
  return Status(StatusCode::kInternal, "the physics engine cannot hold a start state");
}

size_t MujocoEnvironment::state_size() const {
  size_t size = 0;
  for (const StatePart& part : parts_) size += part.values.size();
  return size;
}

void MujocoEnvironment::SaveState(std::span<double> state) const {
  double* out = state.data();
  for (const StatePart& part : parts_) out = std::ranges::copy(part.values, out).out;
}

void MujocoEnvironment::LoadState(std::span<const double> state) {
  const double* in = state.data();
  for (const StatePart& part : parts_) {
    std::copy_n(in, part.values.size(), part.values.data());
    in += part.values.size();
  }
}

NamedState MujocoEnvironment::GetNamedState() const {
  NamedState state;
  for (const StatePart& part : parts_) {
    state[part.name].assign(part.values.begin(), part.values.end());
  }
  return state;
}

Status MujocoEnvironment::SetNamedState(const NamedState& state) {
  std::vector<std::string> names;
  for (const StatePart& part : parts_) names.emplace_back(part.name);
  for (const auto& [name, values] : state) {
    const auto known = std::ranges::find(names, name);
    if (known == names.end()) return UnknownName("state part", name, names);
    const StatePart& part = parts_[known - names.begin()];
    B4MRL_RETURN_IF_ERROR(CheckPart(name, values, part.values.size(), !part.required));
  }
  for (const StatePart& part : parts_) {
    if (!part.required || state.contains(part.name)) continue;
    return Status(StatusCode::kInvalidArgument, fmt::format("state has no part '{}'", part.name));
  }
  const auto copy_parts = [&](bool required) {
    for (const StatePart& part : parts_) {
      const auto given = state.find(part.name);
      if (given == state.end() || part.required != required) continue;
      CopyInto(given->second, part.values.data());
    }
  };
  mj_resetData(&model_, data_);
  copy_parts(true);
  if (!Forward()) {
    return Status(StatusCode::kInvalidArgument, "the physics engine refuses the state");
  }
  copy_parts(false);  // after mj_forward, which writes its own warm start and derived numbers
  KeepUnitQuaternions(state.at("qpos"), qpos());
  return Status();
}

QueryResult MujocoEnvironment::Query(std::span<const double> observation,
                                     std::span<const double> action,
                                     std::span<double> next_observation) {
  std::ranges::fill(next_observation, 0);
  if (!AllFinite(observation) || !AllFinite(action)) return {};
  data_->time = 0;
  std::ranges::fill(qpos(), 0);
  StateFromObservation(observation, qpos(), qvel());
  std::fill_n(data_->qacc_warmstart, model_.nv, 0);
  if (!Guarded([this] { BeforeQuery(); })) return {};
  const StepResult step = Step(action);
  if (step.cause == Cause::kNumericalError) return {};
  Observe(next_observation);
  return {.reward = step.reward, .terminated = step.terminated, .valid = true};
}

Status MujocoEnvironment::Draw(Canvas& canvas) {
  const bool placed = Guarded([this] {
    mj_kinematics(&model_, data_);
    mj_comPos(&model_, data_);
    mj_camlight(&model_, data_);
    mj_tendon(&model_, data_);
  });
  if (!placed) return Status(StatusCode::kInternal, "the physics engine cannot place the bodies");
  return canvas.DrawModel(model_, *data_);
}

}  // namespace b4mrl
