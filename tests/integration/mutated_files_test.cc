// Dataset files with random bytes changed, opened through a running daemon: each is refused with an
// error that names a reason, or served whole. The daemon, and sessions beside, notice nothing.
#include <algorithm>
#include <catch2/catch.hpp>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "proto/base/rng.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

constexpr size_t kRows = 60;

// A file with every kind of entry: columns, infos, provenance and a behaviour policy.
void WriteWhole(const std::string& path) {
  const ExampleDataset data = Hiding({9, 16}, MakeExampleDataset({25, 35}, 17, 6));
  DatasetWriter writer = Take(DatasetWriter::Create(path, {.observation_dimensions = 17,
                                                           .action_dimensions = 6,
                                                           .qpos_dimensions = 1,
                                                           .qvel_dimensions = 1}));
  const std::vector<double> infos(kRows, 0.5);
  DatasetRows rows = data.Rows();
  rows.qpos = infos;
  rows.qvel = infos;
  RequireOk(writer.Append(rows));
  DatasetProvenance provenance;
  provenance.name = "HalfCheetah/mutated-v0";
  provenance.environment = "HalfCheetah";
  provenance.hidden_dimensions = {9, 16};
  provenance.parts = {{"SAC", std::string(64, 'a'), 0, 25}, {"TD3", std::string(64, 'b'), 1, 35}};
  provenance.command = "b4mrl dataset make HalfCheetah/mutated-v0";
  RequireOk(writer.SetProvenance(provenance));
  Agent agent;
  agent.observation_dimensions = 17;
  agent.action_dimensions = 6;
  agent.last_fc = {17, 6, std::vector<float>(17 * 6, 0.1f), std::vector<float>(6)};
  agent.output_distribution = OutputDistribution::kTanh;
  RequireOk(writer.SetPolicy(agent));
  RequireOk(writer.Commit());
}

// Changes up to eight bytes anywhere, or cuts the file.
std::string Mutate(std::string bytes, Rng& rng) {
  if (rng.Below(16) == 0) return bytes.substr(0, rng.Below(bytes.size()));
  for (uint64_t change = rng.Below(8) + 1; change > 0; --change) {
    bytes[rng.Below(bytes.size())] = static_cast<char>(rng.Below(256));
  }
  return bytes;
}

// Opens the dataset and reads it; OK if every row was served.
Status OpenWhole(Client& client, const std::string& name) {
  B4MRL_ASSIGN_OR_RETURN(RemoteDataset dataset, client.OpenDataset(name));
  const auto rows = static_cast<uint32_t>(std::min<uint64_t>(dataset.rows(), 65536));
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows served, dataset.Read(0, rows));
  REQUIRE(served.rows == rows);
  return dataset.Stats().status();
}

bool IsRefusal(StatusCode code) {
  static const std::set<StatusCode> kRefusals = {
      StatusCode::kDataLoss, StatusCode::kInvalidArgument, StatusCode::kUnknownName,
      StatusCode::kLimitExceeded, StatusCode::kFailedPrecondition};
  return kRefusals.contains(code);
}

void OpenMutants(int count) {
  const TemporaryFolder data;
  fs::create_directories(data.File("HalfCheetah"));
  WriteWhole(data.File("HalfCheetah/sound.h5"));
  const std::string whole = ReadBytes(data.File("HalfCheetah/sound.h5"));
  PrivateDaemon daemon =
      StartDaemon({.data_folder = data.path(), .arguments = {"--workers", "1", "--threads", "1"}});
  Client client = Connect(daemon.endpoint());
  // Lanes that never begin another episode take a step for each request.
  RemoteEnvironment bystander =
      Take(client.Make("HalfCheetah", {.autoreset_mode = AutoresetMode::kDisabled}));
  RequireOk(bystander.Reset().status());
  const std::vector<float> action(6, 0.1f);
  Rng rng(1, "mutants");
  int refused = 0, stepped = 0;
  for (int i = 0; i < count; ++i) {
    const std::string name = "HalfCheetah/mutant-" + std::to_string(i);
    WriteBytes(data.File(name + ".h5"), Mutate(whole, rng));
    const Status status = OpenWhole(client, name);
    INFO(i << ": " << status.ToString());
    REQUIRE((status.ok() || IsRefusal(status.code())));
    refused += status.ok() ? 0 : 1;
    fs::remove(data.File(name + ".h5"));
    if (i % 2 == 0) {
      RequireOk(bystander.Step(std::span(action)).status());
      ++stepped;
    }
  }
  WARN(refused << " of " << count << " were refused");
  CHECK(refused > 0);
  CHECK(refused < count);
  RequireOk(OpenWhole(client, "HalfCheetah/sound"));
  CHECK(LookAt(client, "dataset-worker").restarts == 0);
  CHECK(LookAt(client, "worker-0").restarts == 0);
  CHECK(LookAt(client, "worker-0").steps == static_cast<uint64_t>(stepped));
  for (const auto& entry : fs::directory_iterator(data.File(".b4mrl-cache"))) {
    CHECK_FALSE(entry.path().filename().string().starts_with("unfinished-"));
  }
}

TEST_CASE("A thousand dataset files with changed bytes are refused or served") {
  OpenMutants(1000);
}

TEST_CASE("Ten thousand dataset files with changed bytes are refused or served", "[.][long]") {
  OpenMutants(10'000);
}

}  // namespace
}  // namespace b4mrl
