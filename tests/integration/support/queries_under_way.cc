#include "tests/integration/support/queries_under_way.h"

#include <algorithm>
#include <catch2/catch.hpp>

#include "proto/base/limits.h"
#include "tests/integration/support/under_fire.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

constexpr size_t kQueries = 6;
constexpr size_t kRows = limits::kMaxQueryRows;

}  // namespace

QueriesUnderWay::QueriesUnderWay(Client& client, RemoteEnvironment& environment,
                                 const std::string& role)
    : environment_(environment) {
  const std::vector<float> observations(kRows * environment.spec().observation.size());
  const std::vector<float> actions(kRows * environment.spec().action.size(), 0.5f);
  const uint64_t before = LookAt(client, role).requests;
  for (uint64_t draw = 0; draw < kQueries; ++draw) {
    ids_.push_back(Take(environment.SendQuery(observations, actions, 1, draw, 0)));
  }
  const Deadline deadline = Deadline::AfterMs(kFirePatienceMs);
  while (LookAt(client, role).requests < before + kQueries && !deadline.expired()) {
  }
  REQUIRE_FALSE(deadline.expired());
}

void QueriesUnderWay::RequireAnswers() {
  std::vector<float> next(kRows * environment_.spec().observation.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> terminated(kRows), valid(kRows);
  for (const uint64_t id : ids_) {
    std::fill(valid.begin(), valid.end(), 0);
    RequireOk(environment_.ReceiveQuery(id, {next, rewards, terminated, valid}));
    REQUIRE(std::count(valid.begin(), valid.end(), 1) == kRows);
  }
}

}  // namespace b4mrl
