#include "server/environments/mujoco_environment.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <mutex>

#include "server/environments/mujoco_guard.h"
#include "server/perturbations/perturbation.h"

namespace b4mrl {
namespace {

// Beyond this MuJoCo calls a number bad and resets its data (mjMAXVAL).
constexpr double kLargestValue = 1e10;

Result<std::string> ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return IoError("open", path, errno);
  return std::string(std::istreambuf_iterator<char>(file), {});
}

Result<LoadedModel> Compile(const std::string& path, const std::string& file_name) {
  InstallMujocoHandlers();
  auto bytes = ReadFile(path);
  if (!bytes.ok()) return bytes.status();
  char error[1000] = "";
  MjModelPtr model(mj_loadXML(path.c_str(), nullptr, error, sizeof(error)));
  if (model == nullptr) {
    return Status(StatusCode::kDataLoss, fmt::format("model {}: {}", path, error));
  }
  const uint64_t hash = XXH3_64bits(bytes->data(), bytes->size());
  return LoadedModel{std::move(model), fmt::format("{}:{:016x}", file_name, hash)};
}

void CopyInto(std::span<const double> from, double* to) { std::copy(from.begin(), from.end(), to); }

bool AllFinite(std::span<const double> values) {
  return std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
}

// Points `out` at the part called `name` after checking its size and values; an absent optional
// part leaves `out` empty.
Status FindPart(const NamedState& state, const std::string& name, size_t size, bool required,
                std::span<const double>* out) {
  const auto it = state.find(name);
  if (it == state.end()) {
    if (!required) return Status();
    return Status(StatusCode::kInvalidArgument, fmt::format("state has no part '{}'", name));
  }
  if (it->second.size() != size) {
    return InvalidArgument(fmt::format("length of state part '{}'", name),
                           std::to_string(it->second.size()), std::to_string(size));
  }
  for (size_t i = 0; i < size; ++i) {
    if (!(std::abs(it->second[i]) <= kLargestValue)) {
      return InvalidNumber(fmt::format("state {}[{}]", name, i), it->second[i], "-1e10..1e10");
    }
  }
  *out = it->second;
  return Status();
}

}  // namespace

Result<LoadedModel> LoadMujocoModel(const EnvironmentSetup& setup, const std::string& file_name) {
  static std::mutex mutex;
  static std::map<std::string, LoadedModel>* compiled = new std::map<std::string, LoadedModel>;
  const std::string path = setup.models_folder + "/" + file_name;
  LoadedModel loaded;
  {
    const std::lock_guard lock(mutex);
    auto it = compiled->find(path);
    if (it == compiled->end()) {
      B4MRL_ASSIGN_OR_RETURN(LoadedModel fresh, Compile(path, file_name));
      it = compiled->emplace(path, std::move(fresh)).first;
    }
    loaded.model.reset(mj_copyModel(nullptr, it->second.model.get()));
    loaded.identity = it->second.identity;
  }
  if (loaded.model == nullptr) {
    return Status(StatusCode::kUnavailable, "no memory for a model's copy");
  }
  for (const Perturbation* perturbation : setup.perturbations) {
    perturbation->OnModel(loaded.model.get());
  }
  return loaded;
}

Result<MjDataPtr> MakeMujocoData(const mjModel& model) {
  struct Call {
    const mjModel* model;
    mjData* data;
  } call{&model, nullptr};
  const bool made = RunGuarded(
      [](void* argument) {
        auto* c = static_cast<Call*>(argument);
        c->data = mj_makeData(c->model);
      },
      &call);
  if (!made || call.data == nullptr) {
    return Status(StatusCode::kUnavailable, "no memory for another simulator");
  }
  return MjDataPtr(call.data);
}

MujocoEnvironment::MujocoEnvironment(const mjModel& model, MjDataPtr data, int frame_skip)
    : model_(model), data_(std::move(data)), frame_skip_(frame_skip) {}

bool MujocoEnvironment::Guarded(void (*function)(void*)) {
  if (RunGuarded(function, this) && TakeWarnings(data_.get()) == 0) return true;
  mj_resetData(&model_, data_.get());  // also frees the engine's stack after an error
  return false;
}

bool MujocoEnvironment::Simulate(std::span<const double> action) {
  CopyInto(action, data_->ctrl);
  return Guarded([](void* argument) {
    auto* self = static_cast<MujocoEnvironment*>(argument);
    for (int i = 0; i < self->frame_skip_; ++i) mj_step(&self->model_, self->data_.get());
  });
}

bool MujocoEnvironment::Forward() {
  return Guarded([](void* argument) {
    auto* self = static_cast<MujocoEnvironment*>(argument);
    mj_forward(&self->model_, self->data_.get());
  });
}

StepResult MujocoEnvironment::Step(std::span<const double> action) {
  const double progress_before = Progress();
  if (!Simulate(action)) return {.cause = Cause::kNumericalError};
  const StepResult result = Judge(progress_before, action);
  if (!std::isfinite(result.reward)) return {.cause = Cause::kNumericalError};
  return result;
}

Status MujocoEnvironment::Reset(Rng& rng) {
  mj_resetData(&model_, data_.get());
  DrawInitialState(rng, qpos(), qvel());
  if (Forward()) return Status();
  return Status(StatusCode::kInternal, "the physics engine cannot hold a start state");
}

// State: time, qpos, qvel, qacc_warmstart.
size_t MujocoEnvironment::state_size() const {
  return 1 + static_cast<size_t>(model_.nq) + 2 * static_cast<size_t>(model_.nv);
}

void MujocoEnvironment::SaveState(std::span<double> state) const {
  double* out = state.data();
  *out++ = data_->time;
  out = std::copy_n(data_->qpos, model_.nq, out);
  out = std::copy_n(data_->qvel, model_.nv, out);
  std::copy_n(data_->qacc_warmstart, model_.nv, out);
}

void MujocoEnvironment::LoadState(std::span<const double> state) {
  const double* in = state.data();
  data_->time = *in++;
  std::copy_n(in, model_.nq, data_->qpos);
  in += model_.nq;
  std::copy_n(in, model_.nv, data_->qvel);
  std::copy_n(in + model_.nv, model_.nv, data_->qacc_warmstart);
}

Status MujocoEnvironment::SetFromObservation(std::span<const double> observation) {
  for (size_t i = 0; i < observation.size(); ++i) {
    if (!(std::abs(observation[i]) <= kLargestValue)) {
      return InvalidNumber(fmt::format("observation[{}]", i), observation[i], "-1e10..1e10");
    }
  }
  mj_resetData(&model_, data_.get());
  std::ranges::fill(qpos(), 0);
  StateFromObservation(observation, qpos(), qvel());
  if (Forward()) return Status();
  return Status(StatusCode::kInvalidArgument, "the physics engine refuses the observation's state");
}

NamedState MujocoEnvironment::GetNamedState() const {
  const auto part = [](const double* begin, int size) {
    return std::vector<double>(begin, begin + size);
  };
  return {{"time", {data_->time}},
          {"qpos", part(data_->qpos, model_.nq)},
          {"qvel", part(data_->qvel, model_.nv)},
          {"qacc_warmstart", part(data_->qacc_warmstart, model_.nv)}};
}

Status MujocoEnvironment::SetNamedState(const NamedState& state) {
  static const std::vector<std::string> kParts = {"time", "qpos", "qvel", "qacc_warmstart"};
  for (const auto& [name, values] : state) {
    if (std::ranges::find(kParts, name) == kParts.end()) {
      return UnknownName("state part", name, kParts);
    }
  }
  const auto nq = static_cast<size_t>(model_.nq);
  const auto nv = static_cast<size_t>(model_.nv);
  std::span<const double> new_time, new_qpos, new_qvel, warmstart;
  B4MRL_RETURN_IF_ERROR(FindPart(state, "time", 1, false, &new_time));
  B4MRL_RETURN_IF_ERROR(FindPart(state, "qpos", nq, true, &new_qpos));
  B4MRL_RETURN_IF_ERROR(FindPart(state, "qvel", nv, true, &new_qvel));
  B4MRL_RETURN_IF_ERROR(FindPart(state, "qacc_warmstart", nv, false, &warmstart));

  mj_resetData(&model_, data_.get());
  if (!new_time.empty()) data_->time = new_time[0];
  CopyInto(new_qpos, data_->qpos);
  CopyInto(new_qvel, data_->qvel);
  if (!Forward()) {
    return Status(StatusCode::kInvalidArgument, "the physics engine refuses the state");
  }
  CopyInto(warmstart, data_->qacc_warmstart);  // after mj_forward, which writes its own
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
  const StepResult step = Step(action);
  if (step.cause == Cause::kNumericalError) return {};
  Observe(next_observation);
  return {.reward = step.reward, .terminated = step.terminated, .valid = true};
}

}  // namespace b4mrl
