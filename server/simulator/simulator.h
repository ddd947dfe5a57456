// An environment with its configuration and perturbations: what a session simulates. With no
// perturbation it is the real environment.
//
// A Simulator is immutable and shared by threads and sessions; Open returns the same object for the
// same request while that object is in use, so models are compiled once. Scratch environments are
// borrowed from its pool, which grows to the number of threads that step it at once.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "proto/base/spec.h"
#include "proto/base/status.h"
#include "server/environments/config.h"
#include "server/environments/environment.h"
#include "server/environments/list.h"
#include "server/perturbations/perturbation.h"

namespace b4mrl {

struct SimulatorRequest {
  std::string environment;
  std::vector<NamedArgument> perturbations;  // presets or parametric forms, applied in this order
  std::string config;                        // JSON object of settings; "" for none
  CompiledModel compiled_model = {};         // of the perturbation model=FILE.xml, if given
};

// The address of a query's noise: row i of a request draws that of (seed, draw, first_row + i).
struct QueryRow {
  uint64_t seed = 0;
  uint64_t draw = 0;
  uint64_t row = 0;
};

// The version of the numbers that our own code computes in a start, step or query. Raise it with
// every change of these numbers: experiments of another version then have another experiment_id,
// and snapshots of another version are refused.
inline constexpr int kDynamicsVersion = 1;

class Simulator {
 public:
  // Builds or shares the simulator of a request. Unknown names, settings and values are typed
  // errors. Any thread; compiling a model takes about a millisecond and is serialised by MuJoCo.
  static Result<std::shared_ptr<const Simulator>> Open(const SimulatorRequest& request);
  // A Simulator with perturbations that the caller built; not shared. `config` may leave settings
  // out.
  static Result<std::shared_ptr<const Simulator>> Build(std::string_view environment,
                                                        const Config& config,
                                                        PerturbationSet perturbations,
                                                        const CompiledModel& compiled_model = {});

  // The environment's specification, with an info for each number that is drawn for each episode.
  const EnvironmentSpec& spec() const { return spec_; }
  const PerturbationSet& perturbations() const { return perturbations_; }
  // The perturbations with presets resolved, and the settings with defaults filled in.
  std::vector<NamedArgument> resolved_perturbations() const { return perturbations_.items(); }
  const std::string& config_json() const { return config_json_; }
  // Text that names the dynamics: environment, settings, perturbations, model content, the versions
  // of the engine and of our own code.
  const std::string& identity() const { return identity_; }
  uint64_t identity_hash() const { return identity_hash_; }
  // Bytes of memory that the simulator may come to take where `threads` threads step it.
  size_t memory_bytes(uint32_t threads) const {
    return model_->memory_bytes() + threads * environment_bytes_;
  }
  // Number of doubles in the environment's state, and in the states of all perturbations together.
  size_t state_size() const { return state_size_; }
  size_t perturbation_state_size() const { return perturbations_.state_size(); }

  // A borrowed Environment; returns to the pool on destruction. Keep it for one piece of work.
  class Lease {
   public:
    Lease(const Simulator* owner, std::unique_ptr<Environment> environment)
        : owner_(owner), environment_(std::move(environment)) {}
    Lease(Lease&&) = default;
    Lease& operator=(Lease&&) = delete;
    ~Lease();
    Environment& operator*() const { return *environment_; }
    Environment* operator->() const { return environment_.get(); }

   private:
    const Simulator* owner_;
    std::unique_ptr<Environment> environment_;
  };
  // Fails only when memory for a new scratch environment is refused. The Simulator outlives its
  // leases. Where numbers are drawn anew for each episode, call EnterEpisode before all else.
  Result<Lease> Borrow() const;

  // Sets the numbers that the perturbations draw for this episode. To be called before the
  // environment starts, steps or draws a lane in this episode. An error says what the model lacks.
  Status EnterEpisode(Environment& environment, uint64_t lane_seed, uint64_t episode) const {
    if (perturbations_.parameter_names().empty()) return Status();
    return DrawParameters(environment, {DrawContext::Kind::kEpisode, lane_seed, episode, 0});
  }

  // OK when episodes can be played (EnvironmentModel::CheckStart); else the reason. Tried out at
  // the first call and remembered.
  Status CheckStart() const;
  // OK when every perturbation can be applied to single transitions; else the reason.
  Status CheckQueryable() const;
  // Computes one row of T_sim with the perturbations applied, which must be queryable. Sizes as in
  // spec(); inputs may hold anything.
  QueryResult Query(Environment& environment, const QueryRow& row,
                    std::span<const double> observation, std::span<const double> action,
                    std::span<double> next_observation) const;

 private:
  Simulator() = default;
  void Return(std::unique_ptr<Environment> environment) const;
  Status DrawParameters(Environment& environment, const DrawContext& context) const;

  PerturbationSet perturbations_;
  std::shared_ptr<const EnvironmentModel> model_;
  EnvironmentSpec spec_;
  std::string config_json_;
  std::string identity_;
  uint64_t identity_hash_ = 0;
  size_t state_size_ = 0;
  size_t environment_bytes_ = 0;
  mutable std::mutex start_mutex_;
  mutable std::optional<Status> start_;  // what CheckStart has found; under start_mutex_
  mutable std::mutex mutex_;
  mutable std::vector<std::unique_ptr<Environment>> pool_;
};

}  // namespace b4mrl
