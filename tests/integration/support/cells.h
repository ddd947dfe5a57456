// Every environment with every perturbation that the daemon's catalogue lists: the cells that the
// tests of determinism and of snapshots walk through.
#pragma once

#include <string>
#include <vector>

#include "client/client.h"

namespace b4mrl {

struct Cell {
  std::string environment;
  std::vector<NamedArgument> simulator;

  std::string Name() const { return environment + " " + FormatNamedArguments(simulator); }
};

// For each environment: the true one; a range of each perturbation that takes one; each preset it
// has; a value of each perturbation without a preset; and a combination of what disturbs actions
// and observations. Errors for a kind of perturbation that it cannot make up a value of, so that
// none is left out silently.
Result<std::vector<Cell>> CellsOf(const pb::CatalogueReply& catalogue);

// An action of lane seed `seed` at step `step`: uniform over the bounds and a little beyond.
std::vector<double> WalkAction(const EnvironmentSpec& spec, uint64_t seed, uint64_t step);

// What came back of one lane in a step, as bytes.
std::string BytesOfStep(const StepOutcome& outcome, size_t lane, const EnvironmentSpec& spec);

}  // namespace b4mrl
