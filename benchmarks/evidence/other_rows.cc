#include "benchmarks/evidence/other_rows.h"

namespace b4mrl {

std::optional<OtherRows> RunsOnOtherRows(const ScoreTable& table,
                                         const PublishedDatasets& published) {
  std::optional<OtherRows> others;
  double least = 0;
  for (const ScoredRun& run : table.runs()) {
    const PublishedDataset* theirs =
        PublishedOtherwise(published, run.dataset_file, run.columns_sha256);
    if (!run.fills_a_cell || theirs == nullptr) continue;
    const double share = static_cast<double>(run.rows) / static_cast<double>(theirs->rows);
    const size_t runs = others ? others->runs + 1 : 1;
    if (!others || share < least) {
      others = {.dataset = run.dataset_file, .rows = run.rows, .published = theirs->rows};
      least = share;
    }
    others->runs = runs;
  }
  return others;
}

}  // namespace b4mrl
