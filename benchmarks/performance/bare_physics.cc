#include "benchmarks/performance/bare_physics.h"

#include <mujoco/mujoco.h>

#include <atomic>
#include <functional>
#include <thread>

#include "proto/base/clock.h"
#include "proto/base/cores.h"
#include "proto/base/rng.h"

namespace b4mrl::perf {
namespace {

struct DataDeleter {
  void operator()(mjData* data) const { mj_deleteData(data); }
};
using DataPointer = std::unique_ptr<mjData, DataDeleter>;

// One environment after another in one mjData, as a lane would see them.
class BareLane {
 public:
  BareLane(const PhysicsTask& task, const mjModel* model, uint64_t seed)
      : task_(task), model_(model), data_(mj_makeData(model)), rng_(seed, "perf-reset") {
    Reset();
  }

  void Step(const double* action) {
    if (steps_ == task_.episode_steps) Reset();
    mju_copy(data_->ctrl, action, model_->nu);
    for (int i = 0; i < task_.frame_skip; ++i) mj_step(model_, data_.get());
    ++steps_;
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
    for (int i = 0; i < model_->nq; ++i) {
      data_->qpos[i] += rng_.Uniform(-task_.reset_position_noise, task_.reset_position_noise);
    }
    for (int i = 0; i < model_->nv; ++i) {
      data_->qvel[i] = task_.reset_velocity_noise * rng_.Normal();
    }
    mj_forward(model_, data_.get());
    steps_ = 0;
  }

  const PhysicsTask& task_;
  const mjModel* model_;
  DataPointer data_;
  Rng rng_;
  int steps_ = 0;
};

// Calls one(thread, iteration) on a pinned thread a core until the time is over; calls a second.
double RateOnAllCores(double seconds,
                      const std::function<std::function<void(size_t)>(size_t)>& make) {
  const std::vector<int> cores = AvailableCores();
  std::atomic<size_t> ready{0};
  std::atomic<bool> stop{false};
  std::atomic<size_t> total{0};
  std::vector<std::thread> threads;
  for (size_t t = 0; t < cores.size(); ++t) {
    threads.emplace_back([&, t] {
      PinThisThread({cores[t]});
      const std::function<void(size_t)> one = make(t);
      ready.fetch_add(1);
      while (ready.load() < cores.size()) std::this_thread::yield();
      size_t count = 0;
      while (!stop.load(std::memory_order_relaxed)) one(count++);
      total.fetch_add(count);
    });
  }
  while (ready.load() < cores.size()) std::this_thread::yield();
  const Clock::time_point start = Clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));
  stop.store(true);
  for (std::thread& thread : threads) thread.join();
  return static_cast<double>(total.load()) / SecondsSince(start);
}

}  // namespace

const PhysicsTask& HalfCheetahTask() {
  static const PhysicsTask kTask{"HalfCheetah", "half_cheetah.xml", 5, 1000, 0.1, 0.1};
  return kTask;
}

Result<std::unique_ptr<BarePhysics>> BarePhysics::Load(const PhysicsTask& task) {
  const std::string path = std::string(B4MRL_MODELS_FOLDER) + "/" + task.model_file;
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
