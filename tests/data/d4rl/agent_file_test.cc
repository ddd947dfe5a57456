#include "data/d4rl/agent_file.h"

#include <hdf5.h>

#include <catch2/catch.hpp>
#include <cmath>

#include "data/d4rl/dataset_file_writer.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"

namespace b4mrl {
namespace {

AgentLayer MakeLayer(uint32_t inputs, uint32_t outputs, std::string_view name) {
  AgentLayer layer;
  layer.inputs = inputs;
  layer.outputs = outputs;
  layer.weight.resize(size_t{inputs} * outputs);
  layer.bias.resize(outputs);
  Rng rng(3, name);
  rng.FillNormal(layer.weight);
  rng.FillNormal(layer.bias);
  return layer;
}

Agent MakeAgent() {
  Agent agent;
  agent.observation_dimensions = 3;
  agent.action_dimensions = 2;
  agent.history_length = 3;
  agent.hidden = {MakeLayer(9, 8, "fc0"), MakeLayer(8, 5, "fc1")};
  agent.last_fc = MakeLayer(5, 2, "last_fc");
  agent.last_fc_log_std = MakeLayer(5, 2, "last_fc_log_std");
  agent.observation_mask = {1, 0, 1};
  agent.observation_mean = {0.5f, 0.0f, -1.0f};
  agent.observation_std = {1.0f, 2.0f, 0.25f};
  agent.provenance = {.environment = "HalfCheetah",
                      .algorithm = "sac",
                      .seed = 0xfedcba9876543211ull,
                      .updates = 123456,
                      .command = "b4mrl train --algorithm sac",
                      .simulator = "gravity=2",
                      .world = "action-delay",
                      .dataset_sha256 = std::string(64, 'a')};
  return agent;
}

TEST_CASE("an agent file reads back equal") {
  const TemporaryFolder folder;
  const Agent agent = MakeAgent();
  REQUIRE(WriteAgent(folder.File("a.h5"), agent).ok());
  const auto read = ReadAgent(folder.File("a.h5"));
  REQUIRE(read.ok());
  CHECK(read->observation_dimensions == 3);
  CHECK(read->action_dimensions == 2);
  CHECK(read->history_length == 3);
  REQUIRE(read->hidden.size() == 2);
  CHECK(read->hidden[0].weight == agent.hidden[0].weight);
  CHECK(read->hidden[1].bias == agent.hidden[1].bias);
  CHECK(read->last_fc.weight == agent.last_fc.weight);
  CHECK(read->last_fc_log_std->weight == agent.last_fc_log_std->weight);
  CHECK(read->observation_mask == agent.observation_mask);
  CHECK(read->observation_mean == agent.observation_mean);
  CHECK(read->observation_std == agent.observation_std);
  CHECK(read->action_scale == std::vector<float>{1.0f, 1.0f});
  CHECK(read->provenance.seed == agent.provenance.seed);
  CHECK(read->provenance.updates == agent.provenance.updates);
  CHECK(read->provenance.command == agent.provenance.command);
  CHECK(read->provenance.simulator == agent.provenance.simulator);
  CHECK(read->provenance.world == agent.provenance.world);
  CHECK(read->provenance.dataset.empty());
}

TEST_CASE("an agent for the true environment has a file as versions before worlds wrote it") {
  const TemporaryFolder folder;
  Agent agent = MakeAgent();
  agent.provenance.world = "";
  REQUIRE(WriteAgent(folder.File("a.h5"), agent).ok());
  const auto file = Hdf5Reader::Open(folder.File("a.h5"));
  REQUIRE(file.ok());
  CHECK(file->Exists("metadata/simulator"));
  CHECK_FALSE(file->Exists("metadata/world"));
  const auto read = ReadAgent(folder.File("a.h5"));
  REQUIRE(read.ok());
  CHECK(read->provenance.world.empty());
}

TEST_CASE("equal agents give equal bytes") {
  const TemporaryFolder folder;
  REQUIRE(WriteAgent(folder.File("a.h5"), MakeAgent()).ok());
  REQUIRE(WriteAgent(folder.File("b.h5"), MakeAgent()).ok());
  CHECK(ReadBytes(folder.File("a.h5")) == ReadBytes(folder.File("b.h5")));
}

TEST_CASE("a policy inside a dataset file, with D4RL's entries alone, gets the defaults") {
  const TemporaryFolder folder;
  auto file = Hdf5Writer::Create(folder.File("d4rl.hdf5"));
  REQUIRE(file.ok());
  const std::vector<float> weight(2 * 3, 0.5f);
  const std::vector<float> bias(2, 0.1f);
  const uint64_t shape[] = {2, 3};
  for (const char* name : {"last_fc", "last_fc_log_std"}) {
    const std::string group = std::string("metadata/policy/") + name;
    REQUIRE(file->WriteArray(group + "/weight", weight, shape).ok());
    REQUIRE(file->WriteArray(group + "/bias", bias, std::span(shape).first(1)).ok());
  }
  REQUIRE(file->WriteString("metadata/policy/nonlinearity", "relu").ok());
  REQUIRE(file->WriteString("metadata/policy/output_distribution", "tanh_gaussian").ok());
  REQUIRE(file->Commit().ok());
  const auto agent = ReadAgent(folder.File("d4rl.hdf5"));
  REQUIRE(agent.ok());
  CHECK(agent->history_length == 1);
  CHECK(agent->observation_dimensions == 3);
  CHECK(agent->observation_mask == std::vector<uint8_t>{1, 1, 1});
  CHECK(agent->observation_std == std::vector<float>{1, 1, 1});
}

TEST_CASE("strings of variable length, h5py's default, are read like those of fixed length") {
  const TemporaryFolder folder;
  Agent agent = MakeAgent();
  agent.provenance.environment = "Walker2d";
  REQUIRE(WriteAgent(folder.File("a.h5"), agent).ok());
  const hid_t file = H5Fopen(folder.File("a.h5").c_str(), H5F_ACC_RDWR, H5P_DEFAULT);
  const hid_t type = H5Tcopy(H5T_C_S1);
  H5Tset_size(type, H5T_VARIABLE);
  const hid_t space = H5Screate(H5S_SCALAR);
  for (const auto& [path, text] :
       {std::pair{"metadata/environment", "Walker2d"},
        std::pair{"metadata/policy/nonlinearity", "relu"},
        std::pair{"metadata/policy/output_distribution", "tanh_gaussian"}}) {
    REQUIRE(H5Ldelete(file, path, H5P_DEFAULT) >= 0);
    const hid_t dataset =
        H5Dcreate2(file, path, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    REQUIRE(H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, &text) >= 0);
    H5Dclose(dataset);
  }
  H5Sclose(space);
  H5Tclose(type);
  H5Fclose(file);
  const auto read = ReadAgent(folder.File("a.h5"));
  INFO(read.status().ToString());
  REQUIRE(read.ok());
  CHECK(read->provenance.environment == "Walker2d");
  CHECK(read->output_distribution == OutputDistribution::kTanhGaussian);
}

TEST_CASE("inconsistent agents are refused before anything is written") {
  const TemporaryFolder folder;
  const auto refused = [&](const Agent& agent) {
    return WriteAgent(folder.File("a.h5"), agent).code() == StatusCode::kInvalidArgument;
  };
  Agent agent = MakeAgent();
  agent.hidden[1].inputs = 7;
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.last_fc.weight[0] = std::nanf("");
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.last_fc_log_std.reset();
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.output_distribution = OutputDistribution::kTanh;
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.observation_std[1] = 0;
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.observation_mask.pop_back();
  CHECK(refused(agent));
  agent = MakeAgent();
  agent.history_length = 2;
  CHECK(refused(agent));
}

TEST_CASE("a hidden layer that would be passed over is refused by its name") {
  const TemporaryFolder folder;
  const std::string path = folder.File("a.h5");
  const auto refusal = [&](size_t hidden_layers, const std::string& further) {
    Agent agent = MakeAgent();
    agent.hidden = {MakeLayer(9, 5, "fc0")};
    while (agent.hidden.size() < hidden_layers) agent.hidden.push_back(MakeLayer(5, 5, "fc"));
    auto file = Hdf5Writer::Create(path);
    REQUIRE(file.ok());
    REQUIRE(WriteAgentInto(*file, agent).ok());
    if (!further.empty()) {
      const uint64_t shape[] = {5, 5};
      const std::string group = "metadata/policy/" + further;
      const AgentLayer layer = MakeLayer(5, 5, "further");
      REQUIRE(file->WriteArray(group + "/weight", layer.weight, shape).ok());
      REQUIRE(file->WriteArray(group + "/bias", layer.bias, std::span(shape).first(1)).ok());
    }
    REQUIRE(file->Commit().ok());
    const Status status = ReadAgent(path).status();
    CHECK((status.ok() || status.code() == StatusCode::kInvalidArgument));
    return status.message();
  };
  CHECK(refusal(16, "").empty());
  CHECK(refusal(16, "fc16") ==
        path + ": agent: metadata/policy/fc16 is a hidden layer too many, allowed: fc0..fc15");
  CHECK(refusal(2, "fc3") == path + ": agent: metadata/policy/fc3 is there without fc2");
}

TEST_CASE("a damaged or foreign agent file is a typed error") {
  const TemporaryFolder folder;
  CHECK(ReadAgent(folder.File("none.h5")).status().code() == StatusCode::kIoError);
  WriteBytes(folder.File("text.h5"), "not HDF5 at all");
  CHECK(ReadAgent(folder.File("text.h5")).status().code() == StatusCode::kDataLoss);
  REQUIRE(WriteExample(folder.File("data.h5"), MakeExampleDataset({3})).ok());
  CHECK(ReadAgent(folder.File("data.h5")).status().code() == StatusCode::kUnknownName);
  CHECK(ReadAgent(folder.path()).status().code() == StatusCode::kInvalidArgument);
  REQUIRE(WriteAgent(folder.File("a.h5"), MakeAgent()).ok());
  const std::string whole = ReadBytes(folder.File("a.h5"));
  for (size_t size = 0; size < whole.size(); size += 97) {
    WriteBytes(folder.File("cut.h5"), whole.substr(0, size));
    CAPTURE(size);
    CHECK_FALSE(ReadAgent(folder.File("cut.h5")).ok());
  }
}

}  // namespace
}  // namespace b4mrl
