// Blocks of rows are bounded by their bytes, and no number depends on where they end.
#include "data/columns/row_blocks.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "server/datasets/corruption.h"
#include "server/datasets/dataset_environment.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

TransitionColumns SizesOf(uint32_t observations, uint32_t actions) {
  TransitionColumns sizes;
  sizes.observation_size = observations;
  sizes.action_size = actions;
  return sizes;
}

TEST_CASE("a block of wide rows takes no more memory than one of narrow rows") {
  CHECK(BytesOfRow(SizesOf(17, 6)) == 4 * (2 * 17 + 6 + 1) + 2);
  CHECK(RowsAtOnce(SizesOf(17, 6), 16'384) == 16'384);
  const TransitionColumns wide = SizesOf(4'096, 1);
  const uint64_t rows = RowsAtOnce(wide, 65'536);
  CHECK(rows == 255);
  CHECK(rows * BytesOfRow(wide) <= kRowBlockBytes);
  CHECK(RowsAtOnce(SizesOf(10'000'000, 1), 65'536) == 1);
}

TEST_CASE("a corruption of wide rows has the noise of its rows, wherever its blocks end") {
  constexpr uint32_t kWide = 4'096, kAction = 1;
  const uint64_t step = RowsAtOnce(SizesOf(kWide, kAction), 65'536);
  const ExampleDataset data = MakeExampleDataset({step + 45}, kWide, kAction);
  const TransitionColumns source = {
      data.rows(),  data.observation_size,  data.action_size, data.observations, data.actions,
      data.rewards, data.next_observations, data.terminals,   data.timeouts};
  const EnvironmentSpec spec = Take(SpecOfDataset("Wide/w", "Wide", kWide, kAction));
  const Corruption corruption =
      Take(MakeCorruption(ParseNamedArguments("obs-noise=1").value(), spec));
  const TemporaryFolder folder;
  DatasetBuilder builder = Take(DatasetBuilder::Create(folder.File("c"), kWide, kAction));
  RequireOk(AppendCorrupted(source, {corruption.set, 3, 1}, false, &builder));
  RequireOk(builder.Commit());
  const auto noisy = Take(Dataset::Open(folder.File("c")));
  // Within the one episode, a state looks the same from both sides, across the seam, too.
  const auto next = noisy->columns().next_observations.first((data.rows() - 1) * kWide);
  const auto following = noisy->columns().observations.subspan(kWide);
  CHECK(std::ranges::equal(next, following));
}

}  // namespace
}  // namespace b4mrl
