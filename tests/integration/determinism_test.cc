// Results are a function of what was asked and of the seed: not of workers, threads or clients.
#include <algorithm>
#include <catch2/catch.hpp>
#include <string>
#include <thread>
#include <vector>

#include "proto/base/rng.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

constexpr uint32_t kLanes = 16;
constexpr int kSteps = 60;  // one and a half of the short episodes below
constexpr uint64_t kSeed = 20;
constexpr size_t kRows = 300;
constexpr size_t kObservation = 17;
constexpr size_t kAction = 6;

struct Setup {
  uint32_t workers;
  uint32_t threads;
  uint32_t clients;
};

PrivateDaemon StartWith(const Setup& setup, const std::string& data_folder) {
  return StartDaemon({.data_folder = data_folder,
                      .arguments = {"--workers", std::to_string(setup.workers), "--threads",
                                    std::to_string(setup.threads)}});
}

template <typename T>
void Append(std::string* bytes, std::span<const T> values) {
  bytes->append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
}

EnvironmentOptions Options(uint32_t lanes, uint64_t seed) {
  EnvironmentOptions options;
  options.simulator = {{"friction", "0.5"}, {"obs-noise", "0.05"}, {"gravity", "0.5..2"}};
  options.num_envs = lanes;
  options.seed = seed;
  options.observation_dtype = DType::kFloat64;
  options.config = R"({"max_episode_steps": 40})";
  options.deadline_ms = 60'000;
  return options;
}

// Steps lanes [first, first + count) of the whole walk in a session of their own; what came back of
// lane i goes to (*bytes)[i]. Runs on any thread, so it reports instead of requiring.
Status WalkLanes(const std::string& endpoint, uint64_t seed, uint32_t first, uint32_t count,
                 std::vector<std::string>* bytes) {
  B4MRL_ASSIGN_OR_RETURN(Client client, Client::Connect(endpoint));
  B4MRL_ASSIGN_OR_RETURN(RemoteEnvironment environment,
                         client.Make("HalfCheetah", Options(count, seed + first)));
  B4MRL_RETURN_IF_ERROR(environment.Reset().status());
  std::vector<float> actions(count * kAction);
  for (int step = 0; step < kSteps; ++step) {
    for (uint32_t lane = 0; lane < count; ++lane) {
      Rng rng(first + lane, "determinism", static_cast<uint64_t>(step));
      for (size_t i = 0; i < kAction; ++i) {
        actions[lane * kAction + i] = static_cast<float>(rng.Uniform(-1, 1));
      }
    }
    B4MRL_ASSIGN_OR_RETURN(const StepOutcome outcome,
                           environment.Step(std::span<const float>(actions)));
    for (uint32_t lane = 0; lane < count; ++lane) {
      std::string* own = &(*bytes)[first + lane];
      Append(own, outcome.observations.As<double>().subspan(lane * kObservation, kObservation));
      Append(own, outcome.rewards.subspan(lane, 1));
      Append(own, outcome.truncated.subspan(lane, 1));
      Append(own, outcome.digests.subspan(lane, 1));
    }
  }
  return Status();
}

// All lanes, shared out evenly among clients that run at the same time.
std::vector<std::string> Walk(const std::string& endpoint, uint32_t clients, uint64_t seed) {
  std::vector<std::string> bytes(kLanes);
  std::vector<Status> statuses(clients);
  std::vector<std::thread> threads;
  const uint32_t count = kLanes / clients;
  for (uint32_t i = 0; i < clients; ++i) {
    threads.emplace_back(
        [&, i] { statuses[i] = WalkLanes(endpoint, seed, i * count, count, &bytes); });
  }
  for (std::thread& thread : threads) thread.join();
  for (const Status& status : statuses) RequireOk(status);
  return bytes;
}

// The answers to kRows rows, asked for in requests of `rows_per_request`, the last request first.
std::string QueryBytes(Client& client, uint64_t seed, size_t rows_per_request = kRows) {
  Result<RemoteEnvironment> environment = client.Make("HalfCheetah", Options(0, 1));
  RequireOk(environment.status());
  std::vector<float> observations(kRows * kObservation), actions(kRows * kAction);
  Rng rng(9, "query");
  for (float& x : observations) x = static_cast<float>(rng.Uniform(-0.3, 0.3));
  for (float& x : actions) x = static_cast<float>(rng.Uniform(-1, 1));
  std::vector<float> next(observations.size());
  std::vector<double> rewards(kRows);
  std::vector<uint8_t> terminated(kRows), valid(kRows);
  for (size_t end = kRows; end > 0; end -= std::min(end, rows_per_request)) {
    const size_t first = end - std::min(end, rows_per_request);
    const auto part = [&](auto& all, size_t width) {
      return std::span(all).subspan(first * width, (end - first) * width);
    };
    const QueryOutput output = {part(next, kObservation), part(rewards, 1), part(terminated, 1),
                                part(valid, 1)};
    RequireOk(environment->Query(part(observations, kObservation), part(actions, kAction), output,
                                 seed, /*draw=*/0, first));
  }
  std::string bytes;
  Append<float>(&bytes, next);
  Append<double>(&bytes, rewards);
  Append<uint8_t>(&bytes, valid);
  return bytes;
}

std::string BatchBytes(Client& client, uint64_t corruption_seed, uint64_t batch_seed) {
  DatasetOptions options;
  options.corruption = {{"obs-noise", "0.1"}, {"hidden", "9"}};
  options.seed = corruption_seed;
  Result<RemoteDataset> dataset = client.OpenDataset("HalfCheetah/example", options);
  RequireOk(dataset.status());
  const Result<TransitionRows> batch = dataset->Sample(64, batch_seed, 3, 2);
  RequireOk(batch.status());
  std::string bytes;
  Append(&bytes, batch->observations);
  Append(&bytes, batch->actions);
  Append(&bytes, batch->rewards);
  Append(&bytes, batch->next_observations);
  Append(&bytes, batch->terminals);
  return bytes;
}

std::string MakeDataFolder(const TemporaryFolder& folder, const std::string& name) {
  const std::string path = folder.File(name);
  std::filesystem::create_directories(path + "/HalfCheetah");
  RequireOk(WriteExample(path + "/HalfCheetah/example.h5",
                         MakeExampleDataset({50, 60}, kObservation, kAction)));
  return path;
}

TEST_CASE("Equal seeds give equal bytes whatever the workers, threads and clients") {
  const TemporaryFolder folder;
  std::vector<std::string> reference;
  std::string query, batch;
  for (const Setup setup : {Setup{1, 1, 1}, {2, 1, 1}, {1, 4, 8}, {2, 4, 8}}) {
    CAPTURE(setup.workers, setup.threads, setup.clients);
    // A folder for each, so that every daemon imports and corrupts for itself.
    const std::string name = std::to_string(setup.workers * 100 + setup.threads);
    PrivateDaemon daemon = StartWith(setup, MakeDataFolder(folder, name));
    Result<Client> client = Client::Connect(daemon.endpoint());
    RequireOk(client.status());
    const std::vector<std::string> walk = Walk(daemon.endpoint(), setup.clients, kSeed);
    const std::string rows = QueryBytes(*client, 5);
    const std::string transitions = BatchBytes(*client, 6, 7);
    if (reference.empty()) {
      reference = walk;
      query = rows;
      batch = transitions;
    }
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
      CAPTURE(lane);
      REQUIRE(walk[lane] == reference[lane]);
    }
    REQUIRE(rows == query);
    for (const size_t rows_per_request : {1, 7, 299}) {
      CAPTURE(rows_per_request);
      REQUIRE(QueryBytes(*client, 5, rows_per_request) == query);
    }
    REQUIRE(transitions == batch);
  }
}

TEST_CASE("Another seed gives other bytes") {
  const TemporaryFolder folder;
  PrivateDaemon daemon = StartWith({1, 1, 1}, MakeDataFolder(folder, "data"));
  Result<Client> client = Client::Connect(daemon.endpoint());
  RequireOk(client.status());
  const std::vector<std::string> first = Walk(daemon.endpoint(), 1, kSeed);
  const std::vector<std::string> second = Walk(daemon.endpoint(), 1, kSeed + kLanes);
  for (uint32_t lane = 0; lane < kLanes; ++lane) REQUIRE(first[lane] != second[lane]);
  REQUIRE(QueryBytes(*client, 5) != QueryBytes(*client, 6));
  REQUIRE(BatchBytes(*client, 6, 7) != BatchBytes(*client, 8, 7));
  REQUIRE(BatchBytes(*client, 6, 7) != BatchBytes(*client, 6, 8));
}

TEST_CASE("The experiment id is equal for equal contents and differs for each that differs") {
  const TemporaryFolder folder;
  PrivateDaemon daemon = StartWith({2, 1, 1}, MakeDataFolder(folder, "data"));
  Result<Client> client = Client::Connect(daemon.endpoint());
  RequireOk(client.status());
  const auto id = [&client](const EnvironmentOptions& options) {
    const Result<RemoteEnvironment> environment = client->Make("HalfCheetah", options);
    RequireOk(environment.status());
    return environment->experiment_id();
  };
  const std::string base = id(Options(2, 1));
  REQUIRE(id(Options(2, 1)) == base);
  REQUIRE(id(Options(2, 2)) != base);
  REQUIRE(id(Options(3, 1)) != base);
  EnvironmentOptions other = Options(2, 1);
  other.simulator[0].argument = "0.51";
  REQUIRE(id(other) != base);
  other = Options(2, 1);
  other.simulator[2].argument = "0.5..2.1";
  REQUIRE(id(other) != base);
  other = Options(2, 1);
  other.config = R"({"max_episode_steps": 41})";
  REQUIRE(id(other) != base);
  other = Options(2, 1);
  other.autoreset_mode = AutoresetMode::kSameStep;
  REQUIRE(id(other) != base);
  other = Options(2, 1);
  other.observation_dtype = DType::kFloat32;
  REQUIRE(id(other) != base);
}

}  // namespace
}  // namespace b4mrl
