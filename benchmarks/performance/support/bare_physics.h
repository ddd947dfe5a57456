// The limit for everything that simulates: MuJoCo's own mj_step and nothing else around it, on one
// pinned thread a core, each with its own mjData of the model file's small buffers.
//
// Control, reset noise and the ends of episodes are those of the environment; reward and
// observation are not computed. One thread calls; the class starts its own.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/status.h"

struct mjModel_;
struct mjData_;

namespace b4mrl::perf {

// What the loop needs to know about a task.
struct PhysicsTask {
  std::string environment;  // "HalfCheetah"
  std::string model_file;   // within the models folder
  int frame_skip;
  int episode_steps;
  double action_bound;
  double reset_noise;      // uniform in +-, of positions
  bool normal_velocities;  // reset_noise is their standard deviation; else uniform as well
  bool (*healthy)(const mjModel_& model, const mjData_& data);  // an unhealthy end resets
};
const PhysicsTask& HalfCheetahTask();
std::span<const PhysicsTask> PhysicsTasks();

// A state and what is done in it: one row of a query.
struct PhysicsRow {
  std::vector<double> position;  // nq
  std::vector<double> velocity;  // nv
  std::vector<double> control;   // nu
};

class BarePhysics {
 public:
  static Result<std::unique_ptr<BarePhysics>> Load(const PhysicsTask& task);
  ~BarePhysics();

  // Environment steps a second, all cores together, under `actions` (rows of nu) used in turn.
  double StepRate(std::span<const double> actions, double seconds) const;
  // Rows a second, all cores together: state set, warm start zeroed, one environment step.
  double QueryRate(std::span<const PhysicsRow> rows, double seconds) const;
  // Makes one environment step a call on the calling thread, under `actions` in turn. Both outlive
  // it.
  std::function<void()> Stepper(std::span<const double> actions) const;

 private:
  BarePhysics(const PhysicsTask& task, mjModel_* model) : task_(task), model_(model) {}

  PhysicsTask task_;
  mjModel_* model_;
};

}  // namespace b4mrl::perf
