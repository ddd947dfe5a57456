#include "algorithms/tools/dataset_source.h"

#include <algorithm>
#include <span>

#include "algorithms/run/check_opening.h"
#include "proto/base/finite.h"

namespace b4mrl {

void DatasetSource::AddTo(CLI::App& app) {
  app.add_option("name", name, "name of the dataset: \"HalfCheetah/medium\"")->required();
  app.add_option("--corruption", corruption,
                 "corruptions of the dataset: \"obs-noise=0.02,hidden=9\"");
  AddCorruptionSeed(app, corruption_seed);
  AddTransitions(app, transitions);
  app.add_flag("--quiet", quiet, "show no progress on stderr");
  daemon.AddTo(app);
}

std::optional<Failure> DatasetSource::Open(const Use& use) const {
  const auto corruptions = ParseNamedArguments(corruption);
  if (!corruptions.ok()) return BadUsage(corruptions.status());
  auto connection = DaemonConnection::Open(daemon);
  if (!connection.ok()) return FromDaemon(connection.status());
  DatasetOptions options;
  options.corruption = *corruptions;
  options.seed = corruption_seed;
  options.transition_rule = transitions;
  auto dataset = connection->client().OpenDataset(name, options);
  if (!dataset.ok()) return FromDataset(dataset.status(), name);
  if (Status status = CheckCorruptionSeed(corruption_seed, *dataset); !status.ok()) {
    return BadUsage(std::move(status));
  }
  return use(connection->client(), *dataset);
}

Status ForEachRows(RemoteDataset& dataset,
                   const std::function<Status(const TransitionRows& rows)>& use) {
  constexpr uint32_t kRowsPerRead = 16'384;
  const uint32_t most = std::min(kRowsPerRead, dataset.max_rows_per_request());
  for (uint64_t row = 0; row < dataset.rows();) {
    B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, dataset.Read(row, most));
    if (rows.rows == 0) return Status(StatusCode::kDataLoss, "the dataset ended too early");
    B4MRL_RETURN_IF_ERROR(use(rows));
    row += rows.rows;
  }
  return Status();
}

Result<OddRows> CountOddRows(RemoteDataset& dataset, const SpaceSpec& action) {
  OddRows odd;
  B4MRL_RETURN_IF_ERROR(ForEachRows(dataset, [&](const TransitionRows& rows) {
    for (size_t row = 0; row < rows.rows; ++row) {
      const auto of_row = [&](std::span<const float> column) {
        const size_t width = column.size() / rows.rows;
        return column.subspan(row * width, width);
      };
      const std::span<const float> taken = of_row(rows.actions);
      const bool is_finite = AllFinite(of_row(rows.observations)) && AllFinite(taken) &&
                             AllFinite(of_row(rows.rewards)) &&
                             AllFinite(of_row(rows.next_observations));
      bool is_inside = true;
      for (size_t i = 0; i < std::min(taken.size(), action.dimensions.size()); ++i) {
        const DimensionSpec& bounds = action.dimensions[i];
        is_inside = is_inside && !(taken[i] < static_cast<float>(bounds.low) ||
                                   taken[i] > static_cast<float>(bounds.high));
      }
      odd.nonfinite += is_finite ? 0 : 1;
      odd.outside += is_inside ? 0 : 1;
    }
    return Status();
  }));
  return odd;
}

}  // namespace b4mrl
