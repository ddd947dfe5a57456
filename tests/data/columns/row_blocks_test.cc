// Blocks of rows are bounded by their bytes, and no number depends on where they end.
#include "data/columns/row_blocks.h"

#include <catch2/catch.hpp>
#include <string>

#include "data/columns/columns_hash.h"
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

TEST_CASE("rows under the rule d4rl and their hash do not depend on where blocks end") {
  constexpr uint32_t kWide = 4'096, kAction = 1;
  const uint64_t step = RowsAtOnce(SizesOf(kWide, kAction), 65'536);
  const ExampleDataset data = MakeExampleDataset({step, 45}, kWide, kAction);
  const TransitionColumns all = {
      data.rows(),  data.observation_size,  data.action_size, data.observations, data.actions,
      data.rewards, data.next_observations, data.terminals,   data.timeouts};
  const auto go_on = [] { return Status(); };
  const TemporaryFolder folder;
  const auto appended = [&](const std::string& name, const auto& append) {
    DatasetBuilder builder = Take(DatasetBuilder::Create(folder.File(name), kWide, kAction));
    RequireOk(append(&builder));
    RequireOk(builder.Commit());
    return ReadBytes(folder.File(name) + "/manifest.json");  // has the columns' hashes
  };
  CHECK(appended("blocks", [&](auto* to) { return AppendUnderD4rl(all, go_on, to); }) ==
        appended("whole", [&](auto* to) {
          return to->AppendD4rl(all, 0, all.terminals, all.timeouts, {});
        }));
  ColumnsHash whole;
  whole.Append(all);
  CHECK(Take(HashOfRows(all, go_on)) == whole.Hex());
  const Status stop(StatusCode::kUnavailable, "stop");
  CHECK(HashOfRows(all, [&] { return stop; }).status().code() == StatusCode::kUnavailable);
}

}  // namespace
}  // namespace b4mrl
