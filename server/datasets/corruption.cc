#include "server/datasets/corruption.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <charconv>
#include <cstring>

#include "data/columns/episodes.h"
#include "server/environments/list.h"

namespace b4mrl {
namespace {

constexpr uint64_t kBlockRows = 16384;  // between two looks at `cancelled`
constexpr std::string_view kD4rlFolder = "d4rl/";

std::string LowerCase(std::string_view text) {
  std::string lower(text);
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return std::tolower(c); });
  return lower;
}

EnvironmentSpec UnnamedSpec(const std::string& name, uint32_t observation_size,
                            uint32_t action_size) {
  const auto space = [](std::string_view prefix, uint32_t size) {
    SpaceSpec made;
    made.shape = {size};
    for (uint32_t i = 0; i < size; ++i) {
      made.dimensions.push_back({.name = fmt::format("{}-{}", prefix, i)});
    }
    return made;
  };
  EnvironmentSpec spec;
  spec.name = name.substr(0, name.find('/'));
  spec.observation = space("observation", observation_size);
  spec.action = space("action", action_size);
  return spec;
}

// Perturbs float32 rows in double precision. Elements that no perturbation changes keep their bits,
// payloads of NaN included.
class RowPerturber {
 public:
  RowPerturber(const PerturbationSet& set, uint64_t seed, uint64_t matrix, uint32_t size)
      : set_(set), seed_(seed), matrix_(matrix), before_(size), after_(size) {}

  void Apply(DrawContext::Kind kind, uint64_t row, std::span<float> observation) {
    std::copy(observation.begin(), observation.end(), before_.begin());
    after_ = before_;
    set_.OnObservation({kind, seed_, matrix_, row}, {}, after_);
    for (size_t i = 0; i < observation.size(); ++i) {
      if (std::bit_cast<uint64_t>(after_[i]) != std::bit_cast<uint64_t>(before_[i])) {
        observation[i] = static_cast<float>(after_[i]);
      }
    }
  }

 private:
  const PerturbationSet& set_;
  uint64_t seed_;
  uint64_t matrix_;
  std::vector<double> before_, after_;
};

bool SameBits(std::span<const float> a, std::span<const float> b) {
  return std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

}  // namespace

std::string EnvironmentOfName(const std::string& name) {
  const bool is_d4rl = name.starts_with(kD4rlFolder);
  const std::string rest = name.substr(is_d4rl ? kD4rlFolder.size() : 0);
  const std::string prefix = rest.substr(0, rest.find(is_d4rl ? '-' : '/'));
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    if ((is_d4rl ? LowerCase(entry.name) : std::string(entry.name)) == prefix) {
      return std::string(entry.name);
    }
  }
  return "";
}

Result<EnvironmentSpec> SpecOfDataset(const std::string& name, uint32_t observation_size,
                                      uint32_t action_size) {
  const std::string environment = EnvironmentOfName(name);
  if (environment.empty()) return UnnamedSpec(name, observation_size, action_size);
  B4MRL_ASSIGN_OR_RETURN(const EnvironmentSpec spec, DescribeEnvironment(environment));
  if (spec.observation.size() == observation_size && spec.action.size() == action_size) {
    return spec;
  }
  return Status(StatusCode::kFailedPrecondition,
                fmt::format("dataset '{}' has {} observation and {} action dimensions where {} "
                            "has {} and {}",
                            name, observation_size, action_size, spec.name, spec.observation.size(),
                            spec.action.size()));
}

Result<Corruption> MakeCorruption(const std::vector<NamedArgument>& items,
                                  const EnvironmentSpec& spec) {
  Corruption corruption;
  B4MRL_ASSIGN_OR_RETURN(corruption.set, MakePerturbations(items, spec, PerturbationUse::kDataset));
  B4MRL_ASSIGN_OR_RETURN(corruption.hidden_dimensions,
                         HiddenDimensions(corruption.set.items(), spec));
  return corruption;
}

Status AppendCorrupted(const TransitionColumns& source, const PerturbationSet& set, uint64_t seed,
                       uint64_t matrix, const std::atomic<bool>& cancelled,
                       DatasetBuilder* builder) {
  const size_t size = source.observation_size;
  RowPerturber perturber(set, seed, matrix, source.observation_size);
  std::vector<float> observations, next_observations;
  for (uint64_t first = 0; first < source.rows; first += kBlockRows) {
    if (cancelled) return Cancelled();
    TransitionColumns block = source.Rows(first, std::min(kBlockRows, source.rows - first));
    const auto row_of = [size](std::vector<float>& all, uint64_t row) {
      return std::span(all).subspan(row * size, size);
    };
    const std::span<const float> old = block.observations;
    observations.assign(old.begin(), old.end());
    next_observations.assign(block.next_observations.begin(), block.next_observations.end());
    for (uint64_t i = 0; i < block.rows; ++i) {
      perturber.Apply(DrawContext::Kind::kDataset, first + i, row_of(observations, i));
    }
    for (uint64_t i = 0; i < block.rows; ++i) {
      const uint64_t row = first + i;
      const std::span<float> next = row_of(next_observations, i);
      const bool last = EndsEpisode(source.terminals, source.timeouts, row);
      if (!last && i + 1 < block.rows && SameBits(next, old.subspan((i + 1) * size, size))) {
        // The state is that of the next row, whose perturbed observation is there already.
        std::ranges::copy(row_of(observations, i + 1), next.begin());
      } else if (last) {
        perturber.Apply(DrawContext::Kind::kDatasetLastRow, row, next);
      } else {
        perturber.Apply(DrawContext::Kind::kDataset, row + 1, next);
      }
    }
    block.observations = observations;
    block.next_observations = next_observations;
    B4MRL_RETURN_IF_ERROR(builder->Append(block));
  }
  return Status();
}

Status Cancelled() { return Status(StatusCode::kUnavailable, "it was cancelled; ask again"); }

uint64_t MatrixOfFile(const std::string& sha256) {
  uint64_t matrix = 0;
  const std::string first = sha256.substr(0, 16);
  const auto [end, error] = std::from_chars(first.data(), first.data() + first.size(), matrix, 16);
  return error == std::errc() && end == first.data() + 16 ? matrix : 0;
}

}  // namespace b4mrl
