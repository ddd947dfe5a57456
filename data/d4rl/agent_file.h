// An agent: a policy network with its input and action scaling, and its provenance.
//
// File layout, D4RL's for a behaviour policy, extended:
//   metadata/algorithm, metadata/environment, ...        provenance strings and numbers
//   metadata/policy/nonlinearity                         "relu" or "tanh"
//   metadata/policy/output_distribution                  "tanh_gaussian" or "tanh"
//   metadata/policy/{fc0,fc1,...,last_fc[,last_fc_log_std]}/weight   (outputs, inputs)
//   metadata/policy/{fc0,fc1,...,last_fc[,last_fc_log_std]}/bias     (outputs)
//   metadata/policy/{history_length,observation_mask,observation_mean,observation_std,action_scale}
// D4RL's files lack the entries of the last line, which then take Agent's defaults. Strings may
// have fixed or variable length.
//
// How an agent acts: the input is the last `history_length` observations, oldest first; after a
// reset the episode's first observation is repeated. Each observation is masked (masked dimensions
// become 0), normalised, (o - observation_mean) / observation_std, and masked again. The
// observations are concatenated and passed through the hidden layers. "tanh": action = action_scale
// * tanh(last_fc). "tanh_gaussian": action = action_scale * tanh(mean + exp(log_std) * normal), the
// mean alone when deterministic; log_std is clamped to [-20, 2] as in rlkit. Value types; no thread
// rule. Errors while reading: as hdf5_file.h, and kInvalidArgument when sizes of layers do not fit
// each other, a weight is not finite, a hidden layer is missing between others or there are more
// than 16.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "data/hdf5/hdf5_file.h"
#include "proto/base/status.h"

namespace b4mrl {

inline constexpr uint32_t kMaxAgentLayerWidth = 4096;  // inputs and outputs of a layer
inline constexpr uint32_t kMaxAgentHistory = 64;       // observations that a policy sees
// More than the largest layers take together, 1.3 GB.
inline constexpr uint64_t kMaxAgentFileBytes = 2ull << 30;

struct AgentLayer {
  uint32_t inputs = 0;
  uint32_t outputs = 0;
  std::vector<float> weight;  // (outputs, inputs) row-major, as PyTorch stores it
  std::vector<float> bias;    // (outputs)
};

enum class OutputDistribution { kTanhGaussian, kTanh };
enum class Nonlinearity { kRelu, kTanh };

struct AgentProvenance {
  std::string environment;  // "HalfCheetah": the task that the agent is meant for
  std::string algorithm;    // "SAC" in D4RL's files
  uint64_t seed = 0;
  uint64_t updates = 0;   // gradient steps; metadata/iteration in D4RL's files
  std::string command;    // the command line that trained the agent
  std::string simulator;  // perturbations of the simulator of the training; "" for none
  // Perturbations of the true environment for which the agent was trained, and in which it was
  // evaluated meanwhile; "" for none, and in files of older program versions.
  std::string world;
  std::string dataset;         // the dataset of the training; "" for none
  std::string dataset_sha256;  // SHA-256 of the training dataset's file
  std::string corruption;      // corruptions of the training dataset; "" for none
};

struct Agent {
  uint32_t observation_dimensions = 0;  // of one observation
  uint32_t action_dimensions = 0;
  uint32_t history_length = 1;
  std::vector<AgentLayer> hidden;  // fc0, fc1, ...
  AgentLayer last_fc;
  std::optional<AgentLayer> last_fc_log_std;  // if and only if the output is kTanhGaussian
  Nonlinearity nonlinearity = Nonlinearity::kRelu;
  OutputDistribution output_distribution = OutputDistribution::kTanhGaussian;
  // Mask, mean and std have one entry per dimension of one observation, or are empty.
  std::vector<uint8_t> observation_mask;  // 1: seen by the policy, 0: hidden; empty means all 1
  std::vector<float> observation_mean;    // empty means all 0
  std::vector<float> observation_std;     // empty means all 1
  std::vector<float> action_scale;        // one per action dimension; empty means all 1
  AgentProvenance provenance;

  // OK if sizes are consistent and within limits, and weights are finite.
  Status Validate() const;
  // Replaces empty mask, mean, std and scale by their defaults.
  void FillDefaults();
};

// Writes an agent file, complete or not at all (atomic_file.h). Equal agents give equal bytes.
Status WriteAgent(const std::string& path, const Agent& agent);
// Reads an agent file, or a D4RL dataset file with a group metadata/policy.
Result<Agent> ReadAgent(const std::string& path);
// Read and write the same entries in a file that holds other entries as well.
Result<Agent> ReadAgentFrom(const Hdf5Reader& file);
Status WriteAgentInto(Hdf5Writer& file, const Agent& agent);

}  // namespace b4mrl
