// What a simulated task is. Read this first; then simulator.h (an environment with its
// perturbations) and lane_stepper.h (episodes: limits, resets, truncation).
//
// An Environment is a scratch simulator, not a lane. A lane's state is a flat array of doubles that
// its owner keeps (server/simulator/lane_record.h); a step is LoadState, Step, SaveState,
// Observe, on whichever Environment is free. LoadState sets everything that Step, Observe and
// SaveState read, so one object can serve lanes in any order and the numbers never depend on which
// object or thread served.
//
// An Environment knows neither perturbations nor the network protocol. Thread rule: one thread at a
// time per Environment; an EnvironmentModel is immutable and shared. Arrays are float64 and
// row-major; callers guarantee the sizes that spec() and state_size() say (a client's bytes are
// checked before).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "proto/base/rng.h"
#include "proto/base/spec.h"
#include "proto/base/status.h"

namespace b4mrl {

class Canvas;

struct StepResult {
  double reward = 0;
  bool terminated = false;
  // kNone, kUnhealthy (with terminated) or kNumericalError. After kNumericalError the reward is 0,
  // and the object holds no meaningful state until the next LoadState, Reset or Query.
  Cause cause = Cause::kNone;
};

struct QueryResult {
  double reward = 0;
  bool terminated = false;
  bool valid = false;  // false: an input was not finite or the engine warned; all outputs are 0
};

// A state as users read and set it: name -> values, such as "qpos" -> 9 numbers.
using NamedState = std::map<std::string, std::vector<double>>;

class Environment {
 public:
  virtual ~Environment() = default;

  virtual const EnvironmentSpec& spec() const = 0;
  // Number of doubles in a state, as SaveState writes it.
  virtual size_t state_size() const = 0;
  // Bytes of memory that the object may come to take. An environment of our own code takes less
  // than the default.
  virtual size_t memory_bytes() const { return 128 << 10; }

  // Sets the parameters: the numbers that perturbations draw anew for each episode and each row of
  // a query. To be called before an episode's start or steps and before a query; equal parameters
  // cost a comparison. After an error the object must not be used until a call succeeds.
  Status SetParameters(std::span<const double> parameters);
  std::span<const double> parameters() const { return parameters_; }

  // Starts an episode with noise from `rng`. Fails only if the physics engine refuses the start
  // state.
  virtual Status Reset(Rng& rng) = 0;
  // Starts episode number `episode` (from 0) of a lane with seed `lane_seed`. Highway overrides
  // this function, to draw the random numbers that highway-env draws.
  virtual Status StartEpisode(uint64_t lane_seed, uint64_t episode) {
    Rng rng(lane_seed, "reset", episode);
    return Reset(rng);
  }
  // One control step. `action` is finite; values outside the action space follow the task's own
  // rule.
  virtual StepResult Step(std::span<const double> action) = 0;
  // Step for an action that arrived as float32, and that no perturbation has made float64. It
  // differs from Step only where EnvironmentModel::maps_float32.
  virtual StepResult StepFloat32(std::span<const double> action) { return Step(action); }
  // Whether an episode of `elapsed_steps` steps has reached its time limit. Highway compares the
  // simulated time instead, which is part of its state.
  virtual bool TimeIsOver(uint64_t elapsed_steps) const {
    return elapsed_steps >= spec().max_episode_steps;
  }
  virtual void Observe(std::span<double> observation) const = 0;
  // The values of Gymnasium's info dictionary, in the order of spec().info_names, after the last
  // Reset, SetNamedState or Step (LoadState does not restore them). A reset fills in those of
  // spec().reset_info_names; the others are 0.
  virtual void Infos(std::span<double> /*infos*/) const {}
  virtual void SaveState(std::span<double> state) const = 0;
  virtual void LoadState(std::span<const double> state) = 0;

  // GetNamedState gives the state under readable names, and SetNamedState sets it. Unknown names,
  // missing parts, wrong sizes and values that are not finite are refused.
  virtual NamedState GetNamedState() const = 0;
  virtual Status SetNamedState(const NamedState& state) = 0;

  // One step of the paper's T_sim: from the state that `observation` describes, by `action`, to
  // `next_observation`. A pure function of its inputs, whatever the object did before.
  virtual QueryResult Query(std::span<const double> observation, std::span<const double> action,
                            std::span<double> next_observation) = 0;

  // Draws the state that LoadState brought. Afterwards the object holds no meaningful state until
  // the next LoadState, Reset or Query. kUnsupported for a task that cannot be drawn.
  virtual Status Draw(Canvas& /*canvas*/) {
    return Status(StatusCode::kUnsupported, spec().name + " cannot be drawn");
  }

 private:
  // Changes the task's settings or model as `parameters` demand. Afterwards the object holds no
  // meaningful state until the next LoadState, Reset or Query.
  virtual Status ApplyParameters(std::span<const double> /*parameters*/) { return Status(); }

  std::vector<double> parameters_;
};

inline Status Environment::SetParameters(std::span<const double> parameters) {
  if (std::ranges::equal(parameters, parameters_)) return Status();
  parameters_.clear();
  B4MRL_RETURN_IF_ERROR(ApplyParameters(parameters));
  parameters_.assign(parameters.begin(), parameters.end());
  return Status();
}

// What the Environments of one task, configuration and set of perturbations share: the compiled
// model. Immutable; any thread.
class EnvironmentModel {
 public:
  virtual ~EnvironmentModel() = default;
  virtual const EnvironmentSpec& spec() const = 0;
  // The model's content, for experiment ids: equal text, equal dynamics under one engine version.
  virtual std::string Identity() const = 0;
  // Whether an action's own precision counts, as in highway-env.
  virtual bool maps_float32() const { return false; }
  // Bytes of memory that the object takes beside what all models of its kind share.
  virtual size_t memory_bytes() const { return 0; }
  // OK unless a user's model is such that no episode would last for more than a step; then the
  // reason.
  virtual Status CheckStart() const { return Status(); }
  // OK if an observation tells the state that a query has to start from; else the reason.
  virtual Status CheckQueryable() const { return Status(); }
  virtual Result<std::unique_ptr<Environment>> NewEnvironment() const = 0;
};

}  // namespace b4mrl
