// Daemons that share a data folder, as those of several trainings, containers or hosts do.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Entries of a cache folder that are column caches: fingerprints as names.
size_t CountCaches(const TemporaryFolder& data) {
  size_t caches = 0;
  for (const auto& entry : fs::directory_iterator(data.File(".b4mrl-cache"))) {
    caches += entry.path().filename().string().size() == 32 ? 1 : 0;
    REQUIRE_FALSE(entry.path().filename().string().starts_with("unfinished-"));
  }
  return caches;
}

Result<std::vector<float>> ServedObservations(const std::string& endpoint) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  B4MRL_ASSIGN_OR_RETURN(
      RemoteDataset dataset,
      client.OpenDataset("HalfCheetah/new", {.corruption = {{"obs-noise", "0.1"}}}));
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, dataset.Read(0, 500));
  return std::vector<float>(rows.observations.begin(), rows.observations.end());
}

TEST_CASE("Daemons that import and corrupt the same file at once make one set of caches") {
  const TemporaryFolder data;
  fs::create_directories(data.File("HalfCheetah"));
  RequireOk(WriteExample(data.File("HalfCheetah/new.h5"),
                         MakeExampleDataset(std::vector<size_t>(40, 500), 17, 6)));
  std::vector<PrivateDaemon> daemons;
  for (int i = 0; i < 2; ++i) {
    daemons.push_back(StartDaemon(
        {.data_folder = data.path(), .arguments = {"--workers", "1", "--threads", "1"}}));
  }
  std::vector<Result<std::vector<float>>> served(4, Status(StatusCode::kInternal, "not asked"));
  std::vector<std::thread> clients;
  for (size_t i = 0; i < served.size(); ++i) {  // two clients of each daemon
    clients.emplace_back([&, i] { served[i] = ServedObservations(daemons[i % 2].endpoint()); });
  }
  for (std::thread& client : clients) client.join();
  for (const auto& observations : served) {
    RequireOk(observations.status());
    CHECK(*observations == *served[0]);
  }
  CHECK(CountCaches(data) == 2);  // of the file, and of the corrupted data
}

}  // namespace
}  // namespace b4mrl
