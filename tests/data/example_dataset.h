// Small datasets with recognisable numbers, and files made of them. For tests.
#pragma once

#include <catch2/catch.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "data/d4rl/dataset_file_writer.h"
#include "proto/base/rng.h"

namespace b4mrl {

struct ExampleDataset {
  uint32_t observation_size = 3;
  uint32_t action_size = 2;
  std::vector<float> observations, actions, rewards, next_observations;
  std::vector<uint8_t> terminals, timeouts;

  size_t rows() const { return rewards.size(); }
  DatasetRows Rows(size_t first, size_t count) const {
    DatasetRows rows;
    rows.rows = count;
    const auto floats = [&](const std::vector<float>& all, size_t width) {
      return std::span(all).subspan(first * width, count * width);
    };
    rows.observations = floats(observations, observation_size);
    rows.actions = floats(actions, action_size);
    rows.next_observations = floats(next_observations, observation_size);
    rows.rewards = floats(rewards, 1);
    rows.terminals = std::span(terminals).subspan(first, count);
    rows.timeouts = std::span(timeouts).subspan(first, count);
    return rows;
  }
  DatasetRows Rows() const { return Rows(0, rows()); }
};

// Episodes of the given lengths that end by time-out, but for every second one, which ends
// terminally. Inside an episode the next observation is the next row's observation.
inline ExampleDataset MakeExampleDataset(const std::vector<size_t>& lengths,
                                         uint32_t observation_size = 3, uint32_t action_size = 2) {
  ExampleDataset data;
  data.observation_size = observation_size;
  data.action_size = action_size;
  Rng rng(7, "example-dataset");
  const auto append = [&rng](std::vector<float>* to, size_t count) {
    for (size_t i = 0; i < count; ++i) to->push_back(static_cast<float>(rng.Normal()));
  };
  for (size_t episode = 0; episode < lengths.size(); ++episode) {
    std::vector<float> states;
    append(&states, (lengths[episode] + 1) * observation_size);
    data.observations.insert(data.observations.end(), states.begin(),
                             states.end() - observation_size);
    data.next_observations.insert(data.next_observations.end(), states.begin() + observation_size,
                                  states.end());
    append(&data.actions, lengths[episode] * action_size);
    append(&data.rewards, lengths[episode]);
    for (size_t i = 0; i < lengths[episode]; ++i) {
      const bool last = i + 1 == lengths[episode];
      data.terminals.push_back(last && episode % 2 == 1);
      data.timeouts.push_back(last && episode % 2 == 0);
    }
  }
  return data;
}

// `data` with those dimensions of all observations set to 0.
inline ExampleDataset Hiding(const std::vector<uint32_t>& dimensions, ExampleDataset data) {
  for (std::vector<float>* column : {&data.observations, &data.next_observations}) {
    for (const uint32_t dimension : dimensions) {
      for (size_t i = dimension; i < column->size(); i += data.observation_size) (*column)[i] = 0;
    }
  }
  return data;
}

// A file that says `provenance` of its rows.
inline Status WriteExample(const std::string& path, const ExampleDataset& data,
                           const DatasetProvenance& provenance) {
  DatasetWriterOptions options;
  options.observation_dimensions = data.observation_size;
  options.action_dimensions = data.action_size;
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  B4MRL_RETURN_IF_ERROR(writer.Append(data.Rows()));
  B4MRL_RETURN_IF_ERROR(writer.SetProvenance(provenance));
  return writer.Commit();
}

// `environment` and `policy` are what the file says of its environment and its behaviour policy; ""
// for nothing.
inline Status WriteExample(const std::string& path, const ExampleDataset& data,
                           const std::string& environment = "", const std::string& policy = "") {
  DatasetWriterOptions options;
  options.observation_dimensions = data.observation_size;
  options.action_dimensions = data.action_size;
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  B4MRL_RETURN_IF_ERROR(writer.Append(data.Rows()));
  if (!environment.empty()) {
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("environment", environment));
  }
  if (!policy.empty()) B4MRL_RETURN_IF_ERROR(writer.SetMetadata("behaviour_policy", policy));
  return writer.Commit();
}

}  // namespace b4mrl
