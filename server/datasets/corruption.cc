#include "server/datasets/corruption.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "data/columns/episodes.h"
#include "data/columns/row_blocks.h"

namespace b4mrl {
namespace {

constexpr uint64_t kMaxBlockRows = 16384;  // between two looks at `cancelled`

// Perturbs float32 rows in double precision. Elements that no perturbation changes keep their bits,
// payloads of NaN included.
class RowPerturber {
 public:
  RowPerturber(const RowCorruption& corruption, uint32_t size)
      : corruption_(corruption), before_(size), after_(size) {}

  void Apply(DrawContext::Kind kind, uint64_t row, std::span<float> observation) {
    std::copy(observation.begin(), observation.end(), before_.begin());
    after_ = before_;
    corruption_.set.OnObservation({kind, corruption_.seed, corruption_.matrix, row}, {}, after_);
    for (const uint32_t dimension : corruption_.hidden) after_[dimension] = 0;
    for (size_t i = 0; i < observation.size(); ++i) {
      if (std::bit_cast<uint64_t>(after_[i]) != std::bit_cast<uint64_t>(before_[i])) {
        observation[i] = static_cast<float>(after_[i]);
      }
    }
  }

 private:
  const RowCorruption corruption_;
  std::vector<double> before_, after_;
};

bool SameBits(std::span<const float> a, std::span<const float> b) {
  return std::memcmp(a.data(), b.data(), a.size_bytes()) == 0;
}

}  // namespace

Result<Corruption> MakeCorruption(const std::vector<NamedArgument>& items,
                                  const EnvironmentSpec& spec) {
  Corruption corruption;
  B4MRL_ASSIGN_OR_RETURN(corruption.set, MakePerturbations(items, spec, PerturbationUse::kDataset));
  B4MRL_ASSIGN_OR_RETURN(corruption.hidden_dimensions,
                         HiddenDimensions(corruption.set.items(), spec));
  corruption.draws = DrawsForDatasets(corruption.set);
  return corruption;
}

Status AppendCorrupted(const TransitionColumns& source, const RowCorruption& corruption,
                       const std::atomic<bool>& cancelled, DatasetBuilder* builder) {
  const size_t size = source.observation_size;
  RowPerturber perturber(corruption, source.observation_size);
  std::vector<float> observations, next_observations;
  // No number depends on where blocks end: each row's noise is named by the row.
  const uint64_t step = RowsAtOnce(source, kMaxBlockRows);
  for (uint64_t first = 0; first < source.rows; first += step) {
    if (cancelled) return Cancelled();
    TransitionColumns block = source.Rows(first, std::min(step, source.rows - first));
    const auto row_of = [size](std::vector<float>& all, uint64_t row) {
      return std::span(all).subspan(row * size, size);
    };
    observations.assign(block.observations.begin(), block.observations.end());
    next_observations.assign(block.next_observations.begin(), block.next_observations.end());
    for (uint64_t i = 0; i < block.rows; ++i) {
      perturber.Apply(DrawContext::Kind::kDataset, first + i, row_of(observations, i));
    }
    for (uint64_t i = 0; i < block.rows; ++i) {
      const uint64_t row = first + i;
      const std::span<float> next = row_of(next_observations, i);
      const bool is_next_rows = row + 1 < source.rows &&
                                SameBits(next, source.observations.subspan((row + 1) * size, size));
      if (is_next_rows && i + 1 < block.rows) {
        // The state is that of the next row, whose perturbed observation is there already.
        std::ranges::copy(row_of(observations, i + 1), next.begin());
      } else if (is_next_rows || !EndsEpisode(source.terminals, source.timeouts, row)) {
        perturber.Apply(DrawContext::Kind::kDataset, row + 1, next);
      } else {
        perturber.Apply(DrawContext::Kind::kDatasetLastRow, row, next);
      }
    }
    block.observations = observations;
    block.next_observations = next_observations;
    B4MRL_RETURN_IF_ERROR(builder->Append(block));
  }
  return Status();
}

Status Cancelled() { return Status(StatusCode::kUnavailable, "it was cancelled; ask again"); }

}  // namespace b4mrl
