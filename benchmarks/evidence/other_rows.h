// Runs that learned from other rows than those that were published under their dataset's name: from
// a part of them, as with the budget "smoke", or from a file that another program wrote. They are
// runs of other cells than the paper's (benchmarks/RULES.md). Pure functions; any thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "algorithms/datasets/published_datasets.h"
#include "benchmarks/evidence/score_table.h"

namespace b4mrl {

struct OtherRows {
  size_t runs = 0;      // that fill a cell
  std::string dataset;  // of the one with the smallest share of the published rows
  uint64_t rows = 0, published = 0;
};
// Nothing if there is no such run. Datasets that are not published count as they are.
std::optional<OtherRows> RunsOnOtherRows(const ScoreTable& table,
                                         const PublishedDatasets& published);

}  // namespace b4mrl
