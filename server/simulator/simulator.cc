#include "server/simulator/simulator.h"

#include <fmt/format.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "proto/base/finite.h"
#include "proto/base/limits.h"
#include "server/environments/list.h"
#include "server/environments/mujoco/engine_version.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

// Scaling and noise may overflow, by float32's limits whatever the session's dtype is. An
// overflowed row becomes invalid and holds zeros, like a row that the engine warned about.
QueryResult OnlyFinite(const QueryResult& result, std::span<double> next_observation) {
  if (std::isfinite(result.reward) && AllFitFloat32(next_observation)) return result;
  std::ranges::fill(next_observation, 0);
  return {};
}

struct Registry {
  std::mutex mutex;
  std::map<std::string, std::weak_ptr<const Simulator>> open;
};

Registry& OpenSimulators() {
  static Registry* registry = new Registry;
  return *registry;
}

}  // namespace

Result<std::shared_ptr<const Simulator>> Simulator::Open(const SimulatorRequest& request) {
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentEntry* entry, FindEnvironment(request.environment));
  B4MRL_ASSIGN_OR_RETURN(const Config given, ParseConfig(request.config));
  B4MRL_ASSIGN_OR_RETURN(const Config config, entry->complete(given));
  B4MRL_ASSIGN_OR_RETURN(PerturbationSet perturbations,
                         MakePerturbations(request.perturbations, entry->describe(config),
                                           PerturbationUse::kSimulator));
  const std::string key =
      fmt::format("{}\n{}\n{}\n{}", entry->name, config.dump(),
                  FormatNamedArguments(perturbations.items()), request.compiled_model.path);
  Registry& registry = OpenSimulators();
  // The lock is held while building, so that two sessions that open at once compile once.
  const std::lock_guard lock(registry.mutex);
  std::erase_if(registry.open, [](const auto& item) { return item.second.expired(); });
  if (const auto it = registry.open.find(key); it != registry.open.end()) {
    if (auto existing = it->second.lock()) return existing;
  }
  auto built = Build(entry->name, config, std::move(perturbations), request.compiled_model);
  if (built.ok()) registry.open[key] = *built;
  return built;
}

Result<std::shared_ptr<const Simulator>> Simulator::Build(std::string_view environment,
                                                          const Config& config,
                                                          PerturbationSet perturbations,
                                                          const CompiledModel& compiled_model) {
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentEntry* entry, FindEnvironment(environment));
  std::shared_ptr<Simulator> simulator(new Simulator);
  simulator->perturbations_ = std::move(perturbations);
  // The functions below may refer to `set`: the simulator outlives its model and environments.
  const PerturbationSet& set = simulator->perturbations_;
  const std::vector<double> largest = set.LargestParameters();
  Config changed = config;
  set.OnOptions(largest, changed);
  B4MRL_ASSIGN_OR_RETURN(const Config completed, entry->complete(changed));
  const auto config_under = [completed, &set](std::span<const double> parameters) {
    Config other = completed;
    set.OnOptions(parameters, other);
    return other;
  };
  const auto change_model = [&set](std::span<const double> parameters, mjModel_* model) {
    return set.OnModel(parameters, model);
  };
  B4MRL_ASSIGN_OR_RETURN(simulator->model_,
                         entry->open({completed, set.model_file(), compiled_model, largest,
                                      config_under, change_model}));
  simulator->spec_ = simulator->model_->spec();
  for (const std::string& name : set.parameter_names()) {
    simulator->spec_.info_names.push_back(name);
    simulator->spec_.reset_info_names.push_back(name);
  }
  simulator->config_json_ = completed.dump();
  // Noise on float32 actions was once mapped in float32 where it was clipped.
  const bool widens = simulator->model_->maps_float32() && !set.keeps_float32();
  simulator->identity_ = fmt::format(
      "{}; config {}; perturbations {}; model {}{}; {}; dynamics {}", entry->name,
      simulator->config_json_, FormatNamedArguments(set.items()), simulator->model_->Identity(),
      widens ? ", actions in float64" : "", EngineVersion(), kDynamicsVersion);
  simulator->identity_hash_ = XXH3_64bits(simulator->identity_.data(), simulator->identity_.size());
  B4MRL_ASSIGN_OR_RETURN(const Lease first, simulator->Borrow());
  simulator->state_size_ = first->state_size();
  simulator->environment_bytes_ = first->memory_bytes();
  return std::shared_ptr<const Simulator>(std::move(simulator));
}

Result<Simulator::Lease> Simulator::Borrow() const {
  {
    const std::lock_guard lock(mutex_);
    if (!pool_.empty()) {
      std::unique_ptr<Environment> environment = std::move(pool_.back());
      pool_.pop_back();
      return Lease(this, std::move(environment));
    }
  }
  B4MRL_ASSIGN_OR_RETURN(std::unique_ptr<Environment> environment, model_->NewEnvironment());
  B4MRL_RETURN_IF_ERROR(environment->SetParameters(perturbations_.LargestParameters()));
  return Lease(this, std::move(environment));
}

Simulator::Lease::~Lease() {
  if (environment_ != nullptr) owner_->Return(std::move(environment_));
}

void Simulator::Return(std::unique_ptr<Environment> environment) const {
  const std::lock_guard lock(mutex_);
  pool_.push_back(std::move(environment));
}

Status Simulator::DrawParameters(Environment& environment, const DrawContext& context) const {
  std::array<double, limits::kMaxPerturbations> drawn;
  const auto parameters = std::span(drawn).first(perturbations_.parameter_names().size());
  perturbations_.DrawParameters(context, parameters);
  return environment.SetParameters(parameters);
}

Status Simulator::CheckStart() const {
  const std::lock_guard lock(start_mutex_);
  if (start_) return *start_;
  const Status found = model_->CheckStart();
  // Memory that is refused for the moment says nothing of the model.
  if (found.ok() || found.code() == StatusCode::kInvalidArgument) start_ = found;
  return found;
}

Status Simulator::CheckQueryable() const {
  B4MRL_RETURN_IF_ERROR(model_->CheckQueryable());
  for (const auto& perturbation : perturbations_.members()) {
    if (perturbation->state_size(spec()) == 0) continue;
    return Status(StatusCode::kUnsupported,
                  fmt::format("'{}' cannot be queried: it depends on the steps before",
                              perturbation->ToNamedArgument().ToString()));
  }
  return Status();
}

QueryResult Simulator::Query(Environment& environment, const QueryRow& row,
                             std::span<const double> observation, std::span<const double> action,
                             std::span<double> next_observation) const {
  // Asked here, because action-noise clips an infinite action to a finite one.
  if (!AllFinite(observation) || !AllFinite(action)) {
    std::ranges::fill(next_observation, 0);
    return {};
  }
  if (perturbations_.empty()) {
    return OnlyFinite(environment.Query(observation, action, next_observation), next_observation);
  }
  const DrawContext context = {DrawContext::Kind::kQuery, row.seed, row.draw, row.row};
  const bool draws = !perturbations_.parameter_names().empty();
  if (draws && !DrawParameters(environment, context).ok()) {
    std::ranges::fill(next_observation, 0);
    return {};
  }
  std::array<double, limits::kMaxActionDimensions> changed;
  const std::span<double> perturbed_action = std::span(changed).first(action.size());
  std::ranges::copy(action, perturbed_action.begin());
  perturbations_.OnAction(context, {}, perturbed_action);
  QueryResult result = environment.Query(observation, perturbed_action, next_observation);
  if (result.valid) {
    perturbations_.OnReward(context, {}, result.reward);
    perturbations_.OnObservation(context, {}, next_observation);
  }
  return OnlyFinite(result, next_observation);
}

}  // namespace b4mrl
