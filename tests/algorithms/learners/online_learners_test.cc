// Learners that train in a simulator alone, against a fake daemon.
#include <catch2/catch.hpp>
#include <memory>
#include <set>
#include <string_view>
#include <utility>

#include "tests/algorithms/fixtures.h"

namespace b4mrl {

TEST_CASE("An online learner draws other rows of its experience in every update") {
  for (const Algorithm& algorithm : Algorithms()) {
    if (algorithm.needs.dataset) continue;
    INFO(algorithm.name);
    FakeDaemon daemon;
    Client client = Take(Client::Connect(daemon.address()));
    const TemporaryFolder folder;
    LearnerContext context = FakeContext(client, folder.path(), algorithm.hyperparameters);
    // Without a discount a target is its row's reward, whatever the networks learn.
    for (const auto& [name, value] : {std::pair<std::string_view, double>{"lanes", 8},
                                      {"warm-up", 80},
                                      {"batch-size", 8},
                                      {"hidden-width", 8},
                                      {"gamma", 0}}) {
      RequireOk(context.hyperparameters.Set(name, value));
    }
    const std::unique_ptr<Learner> learner = Take(algorithm.create(context));
    Progress quiet(true);
    RequireOk(learner->Prepare(quiet));
    // Eight updates follow one step of all lanes, so that all of them draw from equal experience:
    // eleven steps, whose rewards are different.
    std::set<double> targets;
    for (int update = 0; update < 8; ++update) {
      MetricMeans metrics;
      RequireOk(learner->Update(metrics));
      for (const Metric& metric : metrics.Row()) {
        if (metric.name == "mean_target") targets.insert(metric.value);
      }
    }
    CHECK(targets.size() > 1);
  }
}

}  // namespace b4mrl
