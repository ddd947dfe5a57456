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

}  // namespace
}  // namespace b4mrl
