#include "data/d4rl/agent_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "proto/base/finite.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxHiddenLayers = 16;

// The path of the policy's entry `name`.
std::string PolicyEntry(std::string_view name) { return fmt::format("metadata/policy/{}", name); }

Status Inconsistent(std::string message) {
  return Status(StatusCode::kInvalidArgument, "agent: " + std::move(message));
}

Status CheckLayer(std::string_view name, const AgentLayer& layer, uint64_t inputs,
                  uint64_t outputs) {
  if (layer.inputs != inputs || (outputs != 0 && layer.outputs != outputs)) {
    return Inconsistent(fmt::format("layer {} is {} x {}, allowed: {} x {}", name, layer.outputs,
                                    layer.inputs, outputs == 0 ? layer.outputs : outputs, inputs));
  }
  if (layer.outputs == 0 || layer.outputs > kMaxAgentLayerWidth ||
      layer.inputs > kMaxAgentLayerWidth ||
      layer.weight.size() != size_t{layer.inputs} * layer.outputs ||
      layer.bias.size() != layer.outputs) {
    return Inconsistent(fmt::format("layer {} has {} weights and {} biases for {} x {}", name,
                                    layer.weight.size(), layer.bias.size(), layer.outputs,
                                    layer.inputs));
  }
  if (!AllFinite(layer.weight) || !AllFinite(layer.bias)) {
    return Inconsistent(fmt::format("layer {} has a weight that is not finite", name));
  }
  return Status();
}

template <typename T>
Status CheckPerDimension(std::string_view name, const std::vector<T>& values, size_t dimensions) {
  if (values.empty() || values.size() == dimensions) return Status();
  return Inconsistent(
      fmt::format("{} has {} entries, allowed: {}", name, values.size(), dimensions));
}

Status WriteLayer(Hdf5Writer& file, std::string_view name, const AgentLayer& layer) {
  const std::array<uint64_t, 2> shape = {layer.outputs, layer.inputs};
  B4MRL_RETURN_IF_ERROR(file.WriteArray(PolicyEntry(name) + "/weight", layer.weight, shape));
  return file.WriteArray(PolicyEntry(name) + "/bias", layer.bias, std::span(shape).first(1));
}

Result<AgentLayer> ReadLayer(const Hdf5Reader& file, std::string_view name) {
  const std::string weight_path = PolicyEntry(name) + "/weight";
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column weight, file.OpenColumn(weight_path));
  if (weight.shape().size() != 2 || weight.rows() > kMaxAgentLayerWidth) {
    return Inconsistent(
        fmt::format("{} is not a matrix of at most {} rows", weight_path, kMaxAgentLayerWidth));
  }
  AgentLayer layer;
  layer.outputs = static_cast<uint32_t>(weight.rows());
  layer.inputs = static_cast<uint32_t>(weight.width());
  layer.weight.resize(weight.rows() * weight.width());
  B4MRL_RETURN_IF_ERROR(weight.Read(0, layer.weight));
  B4MRL_ASSIGN_OR_RETURN(layer.bias, file.ReadFloats(PolicyEntry(name) + "/bias"));
  return layer;
}

// Reads an optional entry: it may be absent, but if it is there it must be readable.
Status ReadOptional(const Hdf5Reader& file, const std::string& path, std::string* out) {
  if (!file.Exists(path)) return Status();
  B4MRL_ASSIGN_OR_RETURN(*out, file.ReadText(path));
  return Status();
}

Status ReadOptional(const Hdf5Reader& file, const std::string& path, std::vector<float>* out) {
  if (!file.Exists(path)) return Status();
  B4MRL_ASSIGN_OR_RETURN(*out, file.ReadFloats(path));
  return Status();
}

Status ReadOptional(const Hdf5Reader& file, const std::string& path, double high, uint64_t* out) {
  if (!file.Exists(path)) return Status();
  B4MRL_ASSIGN_OR_RETURN(const double value, file.ReadNumber(path));
  if (!(value >= 0 && value <= high && value == std::floor(value))) {
    return InvalidNumber(path, value, fmt::format("whole numbers in 0..{}", high));
  }
  *out = static_cast<uint64_t>(value);
  return Status();
}

// Reads a seed, which is stored as text: it uses all 64 bits, and numbers are read as doubles.
Status ReadSeed(const Hdf5Reader& file, uint64_t* seed) {
  std::string text;
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/seed", &text));
  if (text.empty()) return Status();
  B4MRL_ASSIGN_OR_RETURN(*seed, ParseUnsigned("metadata/seed", text, 0, UINT64_MAX));
  return Status();
}

Status ReadProvenance(const Hdf5Reader& file, AgentProvenance* out) {
  constexpr double kMaxExactInteger = 9007199254740992.0;
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/environment", &out->environment));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/algorithm", &out->algorithm));
  B4MRL_RETURN_IF_ERROR(ReadSeed(file, &out->seed));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/iteration", kMaxExactInteger, &out->updates));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/command", &out->command));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/simulator", &out->simulator));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/world", &out->world));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/dataset", &out->dataset));
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, "metadata/dataset_sha256", &out->dataset_sha256));
  return ReadOptional(file, "metadata/corruption", &out->corruption);
}

Status WriteProvenance(Hdf5Writer& file, const AgentProvenance& provenance) {
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/environment", provenance.environment));
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/algorithm", provenance.algorithm));
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/seed", fmt::format("{}", provenance.seed)));
  B4MRL_RETURN_IF_ERROR(
      file.WriteInteger("metadata/iteration", static_cast<int64_t>(provenance.updates)));
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/command", provenance.command));
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/simulator", provenance.simulator));
  if (!provenance.world.empty()) {  // without one, files keep the bytes of older program versions
    B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/world", provenance.world));
  }
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/dataset", provenance.dataset));
  B4MRL_RETURN_IF_ERROR(file.WriteString("metadata/dataset_sha256", provenance.dataset_sha256));
  return file.WriteString("metadata/corruption", provenance.corruption);
}

Status ReadKind(const Hdf5Reader& file, Agent* agent) {
  B4MRL_ASSIGN_OR_RETURN(const std::string nonlinearity,
                         file.ReadText(PolicyEntry("nonlinearity")));
  B4MRL_ASSIGN_OR_RETURN(const std::string distribution,
                         file.ReadText(PolicyEntry("output_distribution")));
  if (nonlinearity != "relu" && nonlinearity != "tanh") {
    return InvalidArgument("nonlinearity", nonlinearity, "relu, tanh");
  }
  if (distribution != "tanh_gaussian" && distribution != "tanh") {
    return InvalidArgument("output_distribution", distribution, "tanh_gaussian, tanh");
  }
  agent->nonlinearity = nonlinearity == "relu" ? Nonlinearity::kRelu : Nonlinearity::kTanh;
  agent->output_distribution =
      distribution == "tanh" ? OutputDistribution::kTanh : OutputDistribution::kTanhGaussian;
  return Status();
}

Status ReadLayers(const Hdf5Reader& file, Agent* agent) {
  // A layer that is passed over would make another policy of the others.
  for (size_t i = 0; i <= kMaxHiddenLayers; ++i) {
    const std::string name = fmt::format("fc{}", i);
    if (!file.Exists(PolicyEntry(name))) continue;
    if (i == kMaxHiddenLayers) {
      return Inconsistent(fmt::format("{} is a hidden layer too many, allowed: fc0..fc{}",
                                      PolicyEntry(name), kMaxHiddenLayers - 1));
    }
    if (const size_t next = agent->hidden.size(); i != next) {
      return Inconsistent(fmt::format("{} is there without fc{}", PolicyEntry(name), next));
    }
    B4MRL_ASSIGN_OR_RETURN(AgentLayer layer, ReadLayer(file, name));
    agent->hidden.push_back(std::move(layer));
  }
  B4MRL_ASSIGN_OR_RETURN(agent->last_fc, ReadLayer(file, "last_fc"));
  if (agent->output_distribution == OutputDistribution::kTanhGaussian) {
    B4MRL_ASSIGN_OR_RETURN(agent->last_fc_log_std, ReadLayer(file, "last_fc_log_std"));
  }
  return Status();
}

Status ReadInputs(const Hdf5Reader& file, Agent* agent) {
  uint64_t history = 1;
  B4MRL_RETURN_IF_ERROR(
      ReadOptional(file, PolicyEntry("history_length"), kMaxAgentHistory, &history));
  agent->history_length = static_cast<uint32_t>(history);
  std::vector<float> mask;
  B4MRL_RETURN_IF_ERROR(ReadOptional(file, PolicyEntry("observation_mask"), &mask));
  for (const float entry : mask) agent->observation_mask.push_back(entry != 0 ? 1 : 0);
  B4MRL_RETURN_IF_ERROR(
      ReadOptional(file, PolicyEntry("observation_mean"), &agent->observation_mean));
  B4MRL_RETURN_IF_ERROR(
      ReadOptional(file, PolicyEntry("observation_std"), &agent->observation_std));
  return ReadOptional(file, PolicyEntry("action_scale"), &agent->action_scale);
}

}  // namespace

void Agent::FillDefaults() {
  if (observation_mask.empty()) observation_mask.assign(observation_dimensions, 1);
  if (observation_mean.empty()) observation_mean.assign(observation_dimensions, 0.0f);
  if (observation_std.empty()) observation_std.assign(observation_dimensions, 1.0f);
  if (action_scale.empty()) action_scale.assign(action_dimensions, 1.0f);
}

Status Agent::Validate() const {
  if (observation_dimensions == 0 || observation_dimensions > limits::kMaxObservationDimensions ||
      action_dimensions == 0 || action_dimensions > limits::kMaxActionDimensions ||
      history_length == 0 || history_length > kMaxAgentHistory) {
    return Inconsistent(fmt::format("{} observation dimensions x {} steps, {} action dimensions",
                                    observation_dimensions, history_length, action_dimensions));
  }
  if (hidden.size() > kMaxHiddenLayers) {
    return Inconsistent(
        fmt::format("{} hidden layers, allowed: 0..{}", hidden.size(), kMaxHiddenLayers));
  }
  uint64_t inputs = uint64_t{observation_dimensions} * history_length;
  for (size_t i = 0; i < hidden.size(); ++i) {
    B4MRL_RETURN_IF_ERROR(CheckLayer(fmt::format("fc{}", i), hidden[i], inputs, 0));
    inputs = hidden[i].outputs;
  }
  B4MRL_RETURN_IF_ERROR(CheckLayer("last_fc", last_fc, inputs, action_dimensions));
  if (last_fc_log_std.has_value() != (output_distribution == OutputDistribution::kTanhGaussian)) {
    return Inconsistent("last_fc_log_std belongs to tanh_gaussian, and to it alone");
  }
  if (last_fc_log_std) {
    B4MRL_RETURN_IF_ERROR(
        CheckLayer("last_fc_log_std", *last_fc_log_std, inputs, action_dimensions));
  }
  const uint32_t dimensions = observation_dimensions;
  B4MRL_RETURN_IF_ERROR(CheckPerDimension("observation_mask", observation_mask, dimensions));
  B4MRL_RETURN_IF_ERROR(CheckPerDimension("observation_mean", observation_mean, dimensions));
  B4MRL_RETURN_IF_ERROR(CheckPerDimension("observation_std", observation_std, dimensions));
  B4MRL_RETURN_IF_ERROR(CheckPerDimension("action_scale", action_scale, action_dimensions));
  const bool positive_std = std::all_of(observation_std.begin(), observation_std.end(),
                                        [](float std) { return std > 0 && std::isfinite(std); });
  if (!positive_std || !AllFinite(observation_mean) || !AllFinite(action_scale)) {
    return Inconsistent("mean and action scale must be finite, std finite and above 0");
  }
  return Status();
}

Status WriteAgentInto(Hdf5Writer& file, const Agent& given) {
  B4MRL_RETURN_IF_ERROR(given.Validate());
  Agent agent = given;
  agent.FillDefaults();
  B4MRL_RETURN_IF_ERROR(WriteProvenance(file, agent.provenance));
  const bool relu = agent.nonlinearity == Nonlinearity::kRelu;
  const bool gaussian = agent.output_distribution == OutputDistribution::kTanhGaussian;
  B4MRL_RETURN_IF_ERROR(file.WriteString(PolicyEntry("nonlinearity"), relu ? "relu" : "tanh"));
  B4MRL_RETURN_IF_ERROR(
      file.WriteString(PolicyEntry("output_distribution"), gaussian ? "tanh_gaussian" : "tanh"));
  for (size_t i = 0; i < agent.hidden.size(); ++i) {
    B4MRL_RETURN_IF_ERROR(WriteLayer(file, fmt::format("fc{}", i), agent.hidden[i]));
  }
  B4MRL_RETURN_IF_ERROR(WriteLayer(file, "last_fc", agent.last_fc));
  if (gaussian) {
    B4MRL_RETURN_IF_ERROR(WriteLayer(file, "last_fc_log_std", *agent.last_fc_log_std));
  }
  B4MRL_RETURN_IF_ERROR(file.WriteInteger(PolicyEntry("history_length"), agent.history_length));
  const std::vector<float> mask(agent.observation_mask.begin(), agent.observation_mask.end());
  const std::array<uint64_t, 1> dimensions = {agent.observation_dimensions};
  const std::array<uint64_t, 1> actions = {agent.action_dimensions};
  B4MRL_RETURN_IF_ERROR(file.WriteArray(PolicyEntry("observation_mask"), mask, dimensions));
  B4MRL_RETURN_IF_ERROR(
      file.WriteArray(PolicyEntry("observation_mean"), agent.observation_mean, dimensions));
  B4MRL_RETURN_IF_ERROR(
      file.WriteArray(PolicyEntry("observation_std"), agent.observation_std, dimensions));
  return file.WriteArray(PolicyEntry("action_scale"), agent.action_scale, actions);
}

Status WriteAgent(const std::string& path, const Agent& agent) {
  B4MRL_RETURN_IF_ERROR(agent.Validate());
  B4MRL_ASSIGN_OR_RETURN(Hdf5Writer file, Hdf5Writer::Create(path));
  B4MRL_RETURN_IF_ERROR(WriteAgentInto(file, agent));
  return file.Commit();
}

Result<Agent> ReadAgentFrom(const Hdf5Reader& file) {
  Agent agent;
  B4MRL_RETURN_IF_ERROR(ReadProvenance(file, &agent.provenance));
  B4MRL_RETURN_IF_ERROR(ReadKind(file, &agent));
  B4MRL_RETURN_IF_ERROR(ReadLayers(file, &agent));
  B4MRL_RETURN_IF_ERROR(ReadInputs(file, &agent));
  const uint32_t inputs = agent.hidden.empty() ? agent.last_fc.inputs : agent.hidden[0].inputs;
  if (agent.history_length == 0 || inputs % agent.history_length != 0) {
    return Inconsistent(fmt::format("{} inputs are no multiple of history_length {}", inputs,
                                    agent.history_length));
  }
  agent.observation_dimensions = inputs / agent.history_length;
  agent.action_dimensions = agent.last_fc.outputs;
  B4MRL_RETURN_IF_ERROR(agent.Validate());
  agent.FillDefaults();
  return agent;
}

Result<Agent> ReadAgent(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader file, Hdf5Reader::Open(path));
  Result<Agent> agent = ReadAgentFrom(file);
  if (!agent.ok()) return agent.status().WithContext(path);
  return agent;
}

}  // namespace b4mrl
