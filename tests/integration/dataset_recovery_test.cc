// What clients notice when the process that serves datasets dies: nothing but a pause.
#include <signal.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/under_fire.h"

namespace b4mrl {
namespace {

constexpr uint32_t kBatchRows = 64;
constexpr uint64_t kSeed = 5;

ExampleDataset Example(size_t episodes) {
  return MakeExampleDataset(std::vector<size_t>(episodes, 500), 17, 6);
}

// A data folder with HalfCheetah/example, and a daemon on it that has not imported it yet.
class DatasetDaemon {
 public:
  explicit DatasetDaemon(const ExampleDataset& data) {
    std::filesystem::create_directories(folder_.File("HalfCheetah"));
    RequireOk(WriteExample(folder_.File("HalfCheetah/example.h5"), data));
    daemon_ = std::make_unique<PrivateDaemon>(StartDaemon(
        {.data_folder = folder_.path(), .arguments = {"--workers", "1", "--threads", "1"}}));
    client_ = std::make_unique<Client>(Connect(endpoint()));
  }
  const std::string& endpoint() const { return daemon_->endpoint(); }
  Client& client() { return *client_; }
  Result<RemoteDataset> Open() {
    return client_->OpenDataset("HalfCheetah/example", {.corruption = {{"obs-noise", "0.1"}}});
  }

 private:
  TemporaryFolder folder_;
  std::unique_ptr<PrivateDaemon> daemon_;
  std::unique_ptr<Client> client_;
};

Status Append(BatchStream& stream, std::vector<std::vector<float>>* batches) {
  B4MRL_ASSIGN_OR_RETURN(const TransitionRows rows, stream.Next());
  batches->emplace_back(rows.observations.begin(), rows.observations.end());
  return Status();
}

TEST_CASE("Kills of the dataset worker change no number of a stream of batches") {
  const ExampleDataset data = Example(4);
  DatasetDaemon daemon(data);
  RemoteDataset dataset = Take(daemon.Open());
  BatchStream stream = dataset.Stream(kBatchRows, kSeed);
  std::vector<std::vector<float>> batches;
  AdvanceUnderFire(daemon.endpoint(), {"dataset-worker", SIGKILL, 10},
                   [&] { return Append(stream, &batches); });
  RequireOk(Append(stream, &batches));
  REQUIRE(LookAt(daemon.client(), "dataset-worker").restarts == 10);

  DatasetDaemon undisturbed(data);
  RemoteDataset same = Take(undisturbed.Open());
  BatchStream expected_stream = same.Stream(kBatchRows, kSeed);
  for (const std::vector<float>& batch : batches) {
    std::vector<std::vector<float>> expected;
    RequireOk(Append(expected_stream, &expected));
    REQUIRE(batch == expected[0]);
  }
}

TEST_CASE("An import whose worker is killed is done by the next one") {
  const ExampleDataset data = Example(200);
  DatasetDaemon daemon(data);
  const ProcessView before = LookAt(daemon.client(), "dataset-worker");
  Result<RemoteDataset> dataset = Status(StatusCode::kUnavailable, "not asked for yet");
  std::thread opener([&] { dataset = daemon.Open(); });
  {
    // An import of 100,000 rows takes some tenths of a second.
    Client observer = Connect(daemon.endpoint());
    kill(AwaitRequest(observer, "dataset-worker", before).process_id, SIGKILL);
  }
  opener.join();
  RequireOk(dataset.status());
  REQUIRE(LookAt(daemon.client(), "dataset-worker").restarts == 1);
  REQUIRE(dataset->rows() == data.rows());
  const TransitionRows rows = Take(dataset->Read(data.rows() - 100, 100));
  REQUIRE(std::equal(rows.rewards.begin(), rows.rewards.end(), data.rewards.end() - 100));
}

}  // namespace
}  // namespace b4mrl
