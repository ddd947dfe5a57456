// Learners whose updates take longer than their daemon keeps a session that asks for nothing.
#include <atomic>
#include <catch2/catch.hpp>
#include <memory>

#include "tests/algorithms/fixtures.h"

namespace b4mrl {
namespace {

constexpr uint64_t kShortMs = 1;  // every update of a test takes longer than a third of it
constexpr uint64_t kLongMs = 3'600'000;
constexpr int kManyUpdates = 2000;

// A learner with a fake daemon that counts what keeps a session.
class LeasedLearner {
 public:
  LeasedLearner(std::string_view algorithm, uint64_t lease_ms)
      : daemon_([this](FakeServer& server, FakeCall& call) { return Count(server, call); }),
        client_(Connect(daemon_, lease_ms)),
        context_(FakeContext(client_, folder_.path(), AlgorithmOf(algorithm).hyperparameters)) {
    for (const auto& [name, value] :
         {std::pair{"hidden-width", 8.0},
          {"lanes", algorithm == "h2o" ? 1.0 : 512.0},  // the others step once a lane
          {"warm-up", 512},
          {"batch-size", 16},
          {"real-ratio", 0.5},
          {"steps-per-cycle", 10},
          {"discriminator-batch", 6},
          {"gap-samples", 2},
          {"ensemble-width", 8},
          {"ensemble-max-updates", 1},
          {"ensemble-cache", 0},
          {"rollout-every", 3},
          {"rollout-rows", 20}}) {
      if (context_.hyperparameters.Find(name) == nullptr) continue;
      RequireOk(context_.hyperparameters.Set(name, value));
    }
    learner_ = Take(AlgorithmOf(algorithm).create(context_));
    Progress quiet(true);
    RequireOk(learner_->Prepare(quiet));
  }

  Status Update() {
    MetricMeans metrics;
    return learner_->Update(metrics);
  }
  int opened() const { return opened_; }
  int snapshots() const { return snapshots_; }

 private:
  static Client Connect(FakeDaemon& daemon, uint64_t lease_ms) {
    daemon.session_lease_ms = lease_ms;
    daemon.dataset_environment = "HalfCheetah";
    return Take(Client::Connect(daemon.address()));
  }

  bool Count(FakeServer& server, FakeCall& call) {
    if (call.request.has_open()) ++opened_;
    if (!call.request.has_snapshot()) return false;
    ++snapshots_;
    server.ReplyError(call, Status(StatusCode::kSessionLost, "too late"));
    return true;
  }

  std::atomic<int> opened_ = 0, snapshots_ = 0;
  TemporaryFolder folder_;
  FakeDaemon daemon_;
  Client client_;
  LearnerContext context_;
  std::unique_ptr<Learner> learner_;
};

TEST_CASE("Online learners ask for a state now and then between their turns in the simulator") {
  const std::string algorithm = GENERATE("h2o", "sac", "td3");
  CAPTURE(algorithm);
  LeasedLearner learner(algorithm, kShortMs);
  Status status;
  for (int i = 0; i < kManyUpdates && status.ok(); ++i) status = learner.Update();
  CHECK(learner.snapshots() == 1);
  CHECK(status.code() == StatusCode::kSessionLost);  // of that request's answer
}

TEST_CASE("HyMOPO opens its simulator again for rollouts that come late") {
  LeasedLearner learner("hymopo", kShortMs);
  const int before = learner.opened();
  for (int i = 0; i < kManyUpdates && learner.opened() == before; ++i) RequireOk(learner.Update());
  CHECK(learner.opened() > before);
}

TEST_CASE("A session within its lease gets no request to keep it") {
  LeasedLearner h2o("h2o", kLongMs), sac("sac", kLongMs), hymopo("hymopo", kLongMs);
  const int before = hymopo.opened();
  for (int i = 0; i < 10; ++i) {
    RequireOk(h2o.Update());
    RequireOk(sac.Update());
    RequireOk(hymopo.Update());
  }
  CHECK(h2o.snapshots() == 0);
  CHECK(sac.snapshots() == 0);
  CHECK(hymopo.opened() == before);
}

TEST_CASE("A daemon that does not say its lease is asked for nothing more") {
  LeasedLearner h2o("h2o", 0);
  for (int i = 0; i < 10; ++i) RequireOk(h2o.Update());
  CHECK(h2o.snapshots() == 0);
}

}  // namespace
}  // namespace b4mrl
