// The figures of a dataset: returns of its episodes, and the values of every observation and action
// dimension.
//
// A dimension with one value is not drawn but said in words ("always 0"); so are NaN and infinite
// values, with their number. Pure functions; any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "algorithms/pictures/dataset_tally.h"
#include "algorithms/pictures/figure.h"
#include "proto/base/spec.h"

namespace b4mrl {

struct DatasetDescription {
  std::string name;        // with its version: "HalfCheetah/medium-v0"
  std::string corruption;  // as applied: "obs-noise=0.1 (corruption seed 1)"; "" for none
  // Names and units of dimensions, reference returns; without it, or with other sizes than the
  // dataset's, dimensions have numbers alone.
  std::optional<EnvironmentSpec> environment;
  std::vector<uint32_t> hidden_dimensions;  // by the corruption, or for the behaviour policy
};

// The most panels of a figure; the others follow in further figures.
inline constexpr size_t kMostPanels = 48;

// A histogram of the returns of complete episodes with their mean, and their normalised score as a
// second axis where the environment has reference returns.
Figure ReturnsFigure(const DatasetDescription& dataset, const DatasetTally& tally);

// A histogram for each dimension; `clean` is the dataset without its corruption, if it has one.
std::vector<Figure> ObservationFigures(const DatasetDescription& dataset, const DatasetTally& tally,
                                       const DatasetTally* clean);
std::vector<Figure> ActionFigures(const DatasetDescription& dataset, const DatasetTally& tally);

}  // namespace b4mrl
