#include "algorithms/tools/dataset_source.h"

#include <utility>

namespace b4mrl {

void DatasetSource::AddTo(CLI::App& app) {
  app.add_option("name", name, "name of the dataset: \"HalfCheetah/medium\"")->required();
  app.add_option("--corruption", corruption,
                 "corruptions of the dataset: \"hidden=9,obs-noise=0.02\"");
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
  if (!dataset.ok()) return FromDaemon(dataset.status());
  return use(connection->client(), *dataset);
}

}  // namespace b4mrl
