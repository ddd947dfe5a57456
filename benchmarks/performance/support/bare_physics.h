// The limit for steps and queries of MuJoCo tasks: MuJoCo's own mj_step with nothing around it, on
// one pinned thread a core, each with its own mjData of the model file's small buffers.
//
// Control, reset noise and the ends of episodes are those of the environment; reward and
// observation are not computed. One thread calls; the class starts the threads that simulate.
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/status.h"

struct mjModel_;
struct mjData_;

namespace b4mrl::perf {

// A task's properties that the loop of mj_step needs.
struct PhysicsTask {
  std::string environment;  // "HalfCheetah"
  std::string model_file;   // in the models folder
  int frame_skip;
  int episode_steps;
  double action_bound;
  double reset_noise;      // positions: uniform in +-reset_noise
  bool normal_velocities;  // with standard deviation reset_noise; else as positions
  bool (*healthy)(const mjModel_& model, const mjData_& data);  // if not, a reset
};
const PhysicsTask& HalfCheetahTask();
std::span<const PhysicsTask> PhysicsTasks();

// One row of a query: a state, and the control that is applied in it.
struct PhysicsRow {
  std::vector<double> position;  // nq
  std::vector<double> velocity;  // nv
  std::vector<double> control;   // nu
};

class BarePhysics {
 public:
  static Result<std::unique_ptr<BarePhysics>> Load(const PhysicsTask& task);
  ~BarePhysics();

  // Environment steps a second, all cores together, with the rows of `actions` (nu each) in turn.
  double StepRate(std::span<const double> actions, double seconds) const;
  // Rows a second, all cores together. A row sets the state, zeroes the warm start and steps once.
  double QueryRate(std::span<const PhysicsRow> rows, double seconds) const;
  // A function that makes one environment step on the calling thread, with the rows of `actions` in
  // turn. This object and `actions` outlive the function.
  std::function<void()> Stepper(std::span<const double> actions) const;

 private:
  BarePhysics(const PhysicsTask& task, mjModel_* model) : task_(task), model_(model) {}

  PhysicsTask task_;
  mjModel_* model_;
};

}  // namespace b4mrl::perf
