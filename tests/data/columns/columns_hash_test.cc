#include "data/columns/columns_hash.h"

#include <catch2/catch.hpp>
#include <vector>

namespace b4mrl {
namespace {

std::string HashOfColumns(const TransitionColumns& columns) {
  ColumnsHash hash;
  hash.Append(columns);
  return hash.Hex();
}

// Four rows of two observation dimensions and one action dimension.
struct Rows {
  std::vector<float> observations = {0, 1, 2, 3, 4, 5, 6, 7};
  std::vector<float> actions = {0.5, 1.5, 2.5, 3.5};
  std::vector<float> rewards = {1, 2, 3, 4};
  std::vector<float> next_observations = {2, 3, 4, 5, 6, 7, 8, 9};
  std::vector<uint8_t> terminals = {0, 0, 0, 1};
  std::vector<uint8_t> timeouts = {0, 1, 0, 0};

  TransitionColumns View() const {
    return {.rows = 4,
            .observation_size = 2,
            .action_size = 1,
            .observations = observations,
            .actions = actions,
            .rewards = rewards,
            .next_observations = next_observations,
            .terminals = terminals,
            .timeouts = timeouts};
  }
};

TEST_CASE("the hash of columns is the one that its definition gives") {
  // Computed in Python with hashlib from the definition in columns_hash.h.
  CHECK(HashOfColumns(Rows().View()) ==
        "a304f897b240e9eb98bdc815e7d59e2fbafaff716579ffeb313edce948361e9e");
}

TEST_CASE("the hash of columns does not depend on how the rows are split") {
  const Rows rows;
  ColumnsHash hash;
  hash.Append(rows.View().Rows(0, 1));
  hash.Append(rows.View().Rows(1, 3));
  CHECK(hash.Hex() == HashOfColumns(rows.View()));
}

TEST_CASE("every column and every size changes the hash of columns") {
  const std::string before = HashOfColumns(Rows().View());
  const auto changed = [&](auto change) {
    Rows rows;
    change(rows);
    return HashOfColumns(rows.View()) != before;
  };
  CHECK(changed([](Rows& rows) { rows.observations[7] = 8; }));
  CHECK(changed([](Rows& rows) { rows.actions[0] = 0; }));
  CHECK(changed([](Rows& rows) { rows.rewards[1] = 0; }));
  CHECK(changed([](Rows& rows) { rows.next_observations[0] = 0; }));
  CHECK(changed([](Rows& rows) { rows.terminals[0] = 1; }));
  CHECK(changed([](Rows& rows) { rows.timeouts[0] = 1; }));
  CHECK(changed([](Rows& rows) { std::swap(rows.terminals, rows.timeouts); }));
  const Rows rows;
  TransitionColumns wider = rows.View();
  wider.observation_size = 4;  // the same bytes as rows of other sizes
  CHECK(HashOfColumns(wider) != before);
}

}  // namespace
}  // namespace b4mrl
