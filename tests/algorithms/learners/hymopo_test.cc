// HyMOPO as a learner: what it asks its simulator in rollouts, and what it takes from the answers.
// A fake daemon plays the simulator and serves the dataset.
#include <catch2/catch.hpp>
#include <mutex>
#include <vector>

#include "tests/algorithms/fake_episodes.h"
#include "tests/algorithms/learners/small_model_based.h"

namespace b4mrl {
namespace {

// Walkers in whose simulator every second row of a query ends its episode.
bool ServeFallingWalkers(FakeServer& server, FakeCall& call) {
  return ServeWalkers(server, call) || EndOddRows(server, call);
}

}  // namespace

TEST_CASE("HyMOPO's simulator ends rollouts where no observation tells that an episode ends") {
  SmallModelBased hymopo("hymopo", {{"horizon", 2}, {"rollout-rows", 50}, {"chunk-rows", 20}}, {},
                         ServeFallingWalkers);
  SECTION("without a rule") {
    hymopo.context().environment.termination.reset();
    // Odd rows of the chunks 20, 20 and 10, and then of those that are left, 10, 10 and 5.
    CHECK(Update(*hymopo.CreatePrepared(), 1)["rollout_terminated_rows"] == 25 + 5 + 5 + 2);
  }
  SECTION("with a rule by which no observation ends one") {
    hymopo.context().environment.termination->clear();
    CHECK(Update(*hymopo.CreatePrepared(), 1)["rollout_terminated_rows"] == 0);
  }
}

TEST_CASE("HyMOPO's rollouts go on from observations whose hidden dimensions are zero") {
  std::mutex mutex;
  std::vector<float> asked;  // observations of the last query
  SmallModelBased hymopo("hymopo", {{"horizon", 2}}, /*hidden=*/{1},
                         [&](FakeServer& server, FakeCall& call) {
                           const std::lock_guard lock(mutex);
                           if (call.request.has_query()) {
                             asked = Elements<float>(call, "observations");
                           }
                           return ServeWalkers(server, call);
                         });
  hymopo.context().environment.termination->clear();
  const std::unique_ptr<Learner> learner = hymopo.CreatePrepared();
  Update(*learner, 1);
  const std::lock_guard lock(mutex);
  REQUIRE(asked.size() == 50 * kObservationSize);
  for (size_t i = 0; i < asked.size(); ++i) {
    REQUIRE((asked[i] == 0) == (i % kObservationSize == 1));
  }
}

}  // namespace b4mrl
