// Minari datasets made of example datasets. For tests.
#pragma once

#include <algorithm>
#include <string>
#include <utility>

#include "data/minari/minari_writer.h"
#include "tests/data/example_dataset.h"

namespace b4mrl {

inline MinariDescription DescribeExample(const ExampleDataset& data) {
  MinariDescription description;
  description.observation.dimensions.resize(data.observation_size, {.low = -9, .high = 9});
  description.action.dimensions.resize(data.action_size, {.low = -9, .high = 9});
  return description;
}

// Appends `step` rows at a time.
inline Status WriteMinariExample(const std::string& root, const ExampleDataset& data,
                                 const std::string& id = "x-v0", size_t step = 5) {
  EpisodeLengths episodes;
  B4MRL_RETURN_IF_ERROR(episodes.Append(data.Rows()));
  B4MRL_ASSIGN_OR_RETURN(MinariWriter writer, MinariWriter::Create(root, id, std::move(episodes)));
  for (size_t first = 0; first < data.rows(); first += step) {
    B4MRL_RETURN_IF_ERROR(writer.Append(data.Rows(first, std::min(step, data.rows() - first))));
  }
  return writer.Commit(DescribeExample(data));
}

}  // namespace b4mrl
