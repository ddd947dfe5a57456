#include "tests/integration/support/cells.h"

#include <algorithm>
#include <cctype>

#include "proto/base/rng.h"

namespace b4mrl {
namespace {

// "HalfCheetah" -> "half_cheetah.xml", its own model.
std::string ModelFileOf(const std::string& environment) {
  std::string name;
  for (const char c : environment) {
    if (std::isupper(static_cast<unsigned char>(c)) && !name.empty()) name += '_';
    name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  }
  return name + ".xml";
}

Result<NamedArgument> SomeValue(const pb::PerturbationInfo& info, const std::string& environment) {
  if (info.type() == "number") return NamedArgument{info.name(), "0.5"};
  if (info.type() == "integer") return NamedArgument{info.name(), "3"};
  if (info.type() == "dimensions") return NamedArgument{info.name(), "1+2"};
  if (info.type() == "file") return NamedArgument{info.name(), ModelFileOf(environment)};
  return Status(StatusCode::kInternal, "no value for perturbations of type " + info.type());
}

}  // namespace

Result<std::vector<Cell>> CellsOf(const pb::CatalogueReply& catalogue) {
  std::vector<Cell> cells;
  for (const pb::EnvironmentInfo& environment : catalogue.environments()) {
    cells.push_back({environment.name(), {}});
    for (const pb::PerturbationInfo& info : catalogue.perturbations()) {
      if (std::ranges::count(info.environments(), environment.name()) == 0) continue;
      if (info.takes_range()) {
        const char* range = info.type() == "integer" ? "2..6" : "0.5..1.5";
        cells.push_back({environment.name(), {{info.name(), range}}});
      }
      bool has_preset = false;
      for (const pb::PresetInfo& preset : info.presets()) {
        if (preset.environment() != environment.name()) continue;
        cells.push_back({environment.name(), {{preset.name(), ""}}});
        has_preset = true;
      }
      if (has_preset) continue;
      B4MRL_ASSIGN_OR_RETURN(NamedArgument value, SomeValue(info, environment.name()));
      cells.push_back({environment.name(), {std::move(value)}});
    }
    cells.push_back({environment.name(),
                     {{"action-noise", "0.1"},
                      {"action-delay", "2"},
                      {"obs-noise", "0.01"},
                      {"obs-noise", "0.02"},
                      {"hidden", "1"}}});
  }
  return cells;
}

std::vector<double> WalkAction(const EnvironmentSpec& spec, uint64_t seed, uint64_t step) {
  constexpr double kBeyond = 1.1;
  Rng rng(seed, "cell-walk", step);
  std::vector<double> action;
  for (const DimensionSpec& dimension : spec.action.dimensions) {
    action.push_back(kBeyond * rng.Uniform(dimension.low, dimension.high));
  }
  return action;
}

std::string BytesOfStep(const StepOutcome& outcome, size_t lane, const EnvironmentSpec& spec) {
  std::string bytes;
  const auto append = [&bytes](const auto& values) {
    bytes.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
  };
  const size_t size = spec.observation.size();
  append(outcome.observations.As<double>().subspan(lane * size, size));
  append(outcome.rewards.subspan(lane, 1));
  append(outcome.terminated.subspan(lane, 1));
  append(outcome.truncated.subspan(lane, 1));
  append(outcome.causes.subspan(lane, 1));
  append(outcome.digests.subspan(lane, 1));
  for (size_t i = 0; i < outcome.final_lanes.size(); ++i) {
    if (outcome.final_lanes[i] != lane) continue;
    append(outcome.final_observations.As<double>().subspan(i * size, size));
    append(outcome.final_returns.subspan(i, 1));
    append(outcome.final_lengths.subspan(i, 1));
  }
  return bytes;
}

}  // namespace b4mrl
