// The leaderboard: for every benchmark the algorithms that have results, best first, as CSV.
//
// Results of equal cells that were trained on the same rows, and trained and scored by the same
// side (`source`), are put together: their mean score, its population standard deviation over the
// seeds, and what they used on average. `dataset`, `rows` and `rows_sha256`, the first digits of
// the hash of its columns, say which data these were.
// `entry` says whether a row meets the rules (benchmarks/RULES.md): the published data, seeds 0, 1
// and 2, each seed once and with numbers of its own, ten episodes or more, equally many updates,
// scored by B4MRL, in one precision. Equal results give equal bytes. Any thread.
#pragma once

#include <string>
#include <vector>

#include "algorithms/datasets/published_datasets.h"
#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

// Of all finished results "*.json" of a folder, or of its folder "results", in the order of
// `benchmarks`. What cannot be read, or fills none of these, is left out and, if `skipped` is
// given, named there, a line a file. kIoError.
Result<std::string> Leaderboard(const std::string& results_folder,
                                const std::vector<Benchmark>& benchmarks,
                                const PublishedDatasets& published,
                                std::vector<std::string>* skipped = nullptr);

}  // namespace b4mrl
