#include "benchmarks/performance/support/bare_physics.h"

#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "benchmarks/performance/support/parallel_rate.h"
#include "proto/base/folders.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using DataPointer = std::unique_ptr<mjData, DataDeleter>;

// One episode after another in one mjData, as a lane would see them.
class BareLane {
 public:
  BareLane(const PhysicsTask& task, const mjModel* model, uint64_t seed)
      : task_(task), model_(model), data_(mj_makeData(model)), rng_(seed, "perf-reset") {
    Reset();
  }

  void Step(const double* action) {
    if (ended_) Reset();
    mju_copy(data_->ctrl, action, model_->nu);
    for (int i = 0; i < task_.frame_skip; ++i) mj_step(model_, data_.get());
    ended_ = ++steps_ == task_.episode_steps || !task_.healthy(*model_, *data_);
  }

  void Query(const PhysicsRow& row) {
    mju_copy(data_->qpos, row.position.data(), model_->nq);
    mju_copy(data_->qvel, row.velocity.data(), model_->nv);
    mju_zero(data_->qacc_warmstart, model_->nv);
    mju_copy(data_->ctrl, row.control.data(), model_->nu);
    for (int i = 0; i < task_.frame_skip; ++i) mj_step(model_, data_.get());
  }

 private:
  void Reset() {
    mj_resetData(model_, data_.get());
    const double noise = task_.reset_noise;
    for (int i = 0; i < model_->nq; ++i) data_->qpos[i] += rng_.Uniform(-noise, noise);
    for (int i = 0; i < model_->nv; ++i) {
      data_->qvel[i] =
          task_.normal_velocities ? noise * rng_.Normal() : rng_.Uniform(-noise, noise);
    }
    mj_forward(model_, data_.get());
    steps_ = 0;
    ended_ = false;
  }

  const PhysicsTask& task_;
  const mjModel* model_;
  DataPointer data_;
  Rng rng_;
  int steps_ = 0;
  bool ended_ = false;
};

bool NeverFalls(const mjModel& /*model*/, const mjData& /*data*/) { return true; }

bool HopperStands(const mjModel& model, const mjData& data) {
  const auto bounded = [](double x) { return std::abs(x) < 100; };
  return data.qpos[1] > 0.7 && std::abs(data.qpos[2]) < 0.2 &&
         std::all_of(data.qpos + 2, data.qpos + model.nq, bounded) &&
         std::all_of(data.qvel, data.qvel + model.nv, bounded);
}

bool Walker2dStands(const mjModel& /*model*/, const mjData& data) {
  return data.qpos[1] > 0.8 && data.qpos[1] < 2 && std::abs(data.qpos[2]) < 1;
}

bool HumanoidStands(const mjModel& /*model*/, const mjData& data) {
  return data.qpos[2] > 1 && data.qpos[2] < 2;
}

}  // namespace

std::span<const PhysicsTask> PhysicsTasks() {
  static const PhysicsTask kTasks[] = {
      {"HalfCheetah", "half_cheetah.xml", 5, 1000, 1, 0.1, true, NeverFalls},
      {"Hopper", "hopper.xml", 4, 1000, 1, 5e-3, false, HopperStands},
      {"Walker2d", "walker2d.xml", 4, 1000, 1, 5e-3, false, Walker2dStands},
      {"Humanoid", "humanoid.xml", 5, 1000, 0.4, 1e-2, false, HumanoidStands}};
  return kTasks;
}

const PhysicsTask& HalfCheetahTask() { return PhysicsTasks().front(); }

Result<std::unique_ptr<BarePhysics>> BarePhysics::Load(const PhysicsTask& task) {
  const std::string path = SharedFolder("models", B4MRL_MODELS_FOLDER) + "/" + task.model_file;
  char error[1000] = "";
  mjModel* model = mj_loadXML(path.c_str(), nullptr, error, sizeof(error));
  if (model == nullptr) return InvalidArgument("model", path, error);
  return std::unique_ptr<BarePhysics>(new BarePhysics(task, model));
}

BarePhysics::~BarePhysics() { mj_deleteModel(model_); }

double BarePhysics::StepRate(std::span<const double> actions, double seconds) const {
  const size_t width = model_->nu;
  const size_t rows = actions.size() / width;
  return RateOnAllCores(seconds, [&, width, rows](size_t thread) {
    auto lane = std::make_shared<BareLane>(task_, model_, thread);
    return [=](size_t i) { lane->Step(&actions[(i + thread * 17) % rows * width]); };
  });
}

double BarePhysics::QueryRate(std::span<const PhysicsRow> rows, double seconds) const {
  return RateOnAllCores(seconds, [&, rows](size_t thread) {
    auto lane = std::make_shared<BareLane>(task_, model_, thread);
    return [=](size_t i) { lane->Query(rows[(i + thread * 17) % rows.size()]); };
  });
}

std::function<void()> BarePhysics::Stepper(std::span<const double> actions) const {
  auto lane = std::make_shared<BareLane>(task_, model_, 0);
  const size_t width = model_->nu;
  return [lane, actions, width, i = size_t{0}]() mutable {
    lane->Step(&actions[i++ % (actions.size() / width) * width]);
  };
}

}  // namespace b4mrl::perf
