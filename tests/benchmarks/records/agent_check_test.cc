// An agent's file is held against its result.
#include "benchmarks/records/agent_check.h"

#include <catch2/catch.hpp>
#include <functional>

#include "tests/results.h"

namespace b4mrl {
namespace {

// The faults of a user's agent, changed from one that says what its result says.
std::vector<std::string> FaultsOf(const std::function<void(Agent&)>& change) {
  pb::CatalogueReply catalogue;
  pb::PerturbationInfo* hidden = catalogue.add_perturbations();
  hidden->set_name("hidden");
  pb::PresetInfo* preset = hidden->add_presets();
  preset->set_name("hidden-high");
  preset->set_environment("HalfCheetah");
  preset->set_argument("9");
  const CheckSources sources = {.plan = {.catalogue = &catalogue}};
  const nlohmann::ordered_json result = {
      {"source", "user"},
      {"environment", "HalfCheetah"},
      {"simulator", "gravity"},
      {"dataset", {{"name", "HalfCheetah/medium-v0"}, {"sha256", "aa"}}},
      {"corruption", "hidden-high"},
      {"updates", uint64_t{70}}};
  Agent agent;
  agent.provenance = {.environment = "HalfCheetah",
                      .algorithm = "any",
                      .seed = 3,
                      .updates = 70,
                      .simulator = "gravity",
                      .dataset = "HalfCheetah/medium-v0",
                      .dataset_sha256 = "aa",
                      .corruption = "hidden=9"};
  change(agent);
  return Take(AgentFaults(agent, result, sources));
}

TEST_CASE("What a user's agent says of its training must be what its result says") {
  CHECK(FaultsOf([](Agent&) {}).empty());
  using Faults = std::vector<std::string>;
  CHECK(FaultsOf([](Agent& agent) { agent.provenance.corruption = "hidden=3"; }) ==
        Faults{"its agent has the corruption 'hidden=3', the result 'hidden=9'"});
  CHECK(FaultsOf([](Agent& agent) { agent.provenance.dataset = "HalfCheetah/expert-v0"; }) ==
        Faults{"its agent has the dataset 'HalfCheetah/expert-v0', the result "
               "'HalfCheetah/medium-v0'"});
  CHECK(FaultsOf([](Agent& agent) { agent.provenance.updates = 7; }) ==
        Faults{"its agent has the updates 7, the result 70"});
}

TEST_CASE("What a user's agent leaves out is not held against it") {
  CHECK(FaultsOf([](Agent& agent) { agent.provenance = {}; }).empty());
}

using Json = nlohmann::ordered_json;

// An evaluation of 10 episodes with the mean 100 and the sample deviation 3.16.
const Json kEvaluation = {{"returns", {97, 103, 97, 103, 97, 103, 97, 103, 97, 103}}};

Json ScoredBy(const char* source, const Json& budget, const Json& returns) {
  return {{"source", source}, {"budget", budget}, {"returns", returns}};
}

TEST_CASE("Returns that b4mrl evaluate has measured must be equal to the last bit") {
  Json returns = kEvaluation["returns"];
  CHECK(CompareReturns(kEvaluation, ScoredBy("own", "small", returns)).words ==
        "its agent has these returns");
  returns[0] = 97.0000001;
  for (const char* source : {"own", "user"}) {
    const ComparedReturns compared =
        CompareReturns(kEvaluation, ScoredBy(source, "small", returns));
    CHECK_FALSE(compared.agree);
    CHECK(compared.words.starts_with("its agent has the returns [97,103,"));
  }
  // No result of the project's own lacks a budget.
  CHECK_FALSE(CompareReturns(kEvaluation, ScoredBy("own", nullptr, returns)).agree);
}

TEST_CASE("Means that another program has measured must be equal as far as episodes vary") {
  const auto compared = [](const Json& returns) {
    return CompareReturns(kEvaluation, ScoredBy("user", nullptr, returns));
  };
  CHECK(compared(kEvaluation["returns"]).words == "its agent has these returns");
  // Four standard errors of the difference of two means of ten: 4 * 3.16 * sqrt(2 / 10) = 5.66.
  const Json near(Json::array_t(10, 105.6)), far(Json::array_t(10, 105.7));
  CHECK(compared(near).agree);
  CHECK(compared(near).words ==
        "its agent has the mean return 100, the result 105.6; up to 5.66 apart is chance");
  CHECK_FALSE(compared(far).agree);
  // What the result's own episodes vary does not count.
  CHECK_FALSE(compared({-1e6, 1e6 + 300}).agree);
  CHECK(compared({110}).agree);  // of a single one: 4 * 3.16 * sqrt(1.1) = 13.3
  CHECK_FALSE(compared(Json::array()).agree);
}

TEST_CASE("Means of episodes that do not vary must be equal to a thousandth") {
  const Json evaluation = {{"returns", Json::array_t(10, 100.0)}};
  CHECK(CompareReturns(evaluation, ScoredBy("user", nullptr, {100.09})).agree);
  CHECK_FALSE(CompareReturns(evaluation, ScoredBy("user", nullptr, {100.11})).agree);
}

TEST_CASE("Of an agent that another program has scored, ten episodes or more are evaluated") {
  CHECK(EpisodesToCompare(ScoredBy("own", "small", {1})) == 1);
  CHECK(EpisodesToCompare(ScoredBy("user", "small", {1, 2})) == 2);
  CHECK(EpisodesToCompare(ScoredBy("user", nullptr, {1})) == 10);
  CHECK(EpisodesToCompare(ScoredBy("user", nullptr, Json::array_t(20, 1.0))) == 20);
  CHECK(EpisodesToCompare(ScoredBy("user", nullptr, Json::array())) == 0);
}

}  // namespace
}  // namespace b4mrl
