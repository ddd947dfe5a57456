// What a simulated task is. Read this first; then simulator.h (an environment with its
// perturbations) and lane_stepper.h (episodes: limits, resets, truncation).
//
// An Environment is a scratch simulator, not a lane. A lane's state is a flat array of doubles that
// its owner keeps (server/simulator/lane_record.h); a step is LoadState, Step, SaveState,
// Observe, on whichever Environment is free. LoadState sets everything that Step, Observe and
// SaveState read, so one object can serve lanes in any order and the numbers never depend on which
// object or thread served.
//
// An Environment knows no perturbations or wires. Thread rule: one thread at a
// time per Environment; an EnvironmentModel is immutable and shared. Arrays are float64 and
// row-major; sizes are those of spec() and state_size(), and callers guarantee them (a peer's bytes
// are checked before).
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
  // kNone, kUnhealthy (with terminated) or kNumericalError. After the last the object holds no
  // meaningful state until the next LoadState, Reset or Query; reward is 0.
  Cause cause = Cause::kNone;
};

struct QueryResult {
  double reward = 0;
  bool terminated = false;
  bool valid = false;  // false: an input was not finite or the engine warned; all outputs are 0
};

// A state for users: name -> values, such as "qpos" -> 9 numbers.
using NamedState = std::map<std::string, std::vector<double>>;

class Environment {
 public:
  virtual ~Environment() = default;

  virtual const EnvironmentSpec& spec() const = 0;
  // Doubles that SaveState writes.
  virtual size_t state_size() const = 0;

  // Brings into force the numbers that perturbations draw anew for each episode, before its start,
  // steps or query (EnvironmentSetup::parameters has those at the opening). Cheap if they are in
  // force already. After an error none are, and the object must not be used before a success.
  Status SetParameters(std::span<const double> parameters);
  std::span<const double> parameters() const { return parameters_; }

  // Starts an episode with noise from `rng`. Fails only if the engine cannot hold the state.
  virtual Status Reset(Rng& rng) = 0;
  // Starts the episode that a lane's seed and the number of its reset name. A task whose original's
  // own generator is matched (Highway) overrides it.
  virtual Status StartEpisode(uint64_t lane_seed, uint64_t episode) {
    Rng rng(lane_seed, "reset", episode);
    return Reset(rng);
  }
  // One control step. `action` is finite; values outside the action space follow the task's own
  // rule.
  virtual StepResult Step(std::span<const double> action) = 0;
  // The same for an action that came as float32. It differs where the original computes in the
  // action's own precision (Highway).
  virtual StepResult StepFloat32(std::span<const double> action) { return Step(action); }
  // Whether the episode's time is over after `elapsed_steps` steps. Highway counts the simulated
  // time, which is part of its state.
  virtual bool TimeIsOver(uint64_t elapsed_steps) const {
    return elapsed_steps >= spec().max_episode_steps;
  }
  virtual void Observe(std::span<double> observation) const = 0;
  // What Gymnasium reports beside the observation, under spec().info_names, of the last Reset, Set
  // or Step (LoadState does not bring it back). A reset fills in spec().reset_info_names; the
  // others are 0.
  virtual void Infos(std::span<double> /*infos*/) const {}
  virtual void SaveState(std::span<double> state) const = 0;
  virtual void LoadState(std::span<const double> state) = 0;

  // A state for reading, and its inverse. SetNamedState refuses unknown names, missing parts, wrong
  // sizes and values that are not finite.
  virtual NamedState GetNamedState() const = 0;
  virtual Status SetNamedState(const NamedState& state) = 0;

  // One step of the paper's T_sim: from the state that `observation` describes, by `action`, to
  // `next_observation`. A pure function of its inputs, whatever the object did before.
  virtual QueryResult Query(std::span<const double> observation, std::span<const double> action,
                            std::span<double> next_observation) = 0;

  // Draws the state that LoadState brought. Afterwards the object holds no meaningful state until
  // the next LoadState, Reset or Query. kUnsupported where nobody has written it.
  virtual Status Draw(Canvas& /*canvas*/) {
    return Status(StatusCode::kUnsupported, spec().name + " cannot be drawn");
  }

 private:
  // Changes settings or model to what they are under `parameters`. Afterwards the object holds no
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
  // Whether observations tell the state that a query starts from; else the reason.
  virtual Status CheckQueryable() const { return Status(); }
  virtual Result<std::unique_ptr<Environment>> NewEnvironment() const = 0;
};

}  // namespace b4mrl
