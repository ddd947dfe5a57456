// A server may send anything: the client answers with a Status, never with a crash.
#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "client/client.h"
#include "proto/base/rng.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

constexpr int kRounds = 400;

// Replies whose arrays have the names that clients look for, and are otherwise right or absurd.
class HostileReplies {
 public:
  bool operator()(FakeServer& server, FakeCall& call) {
    switch (call.request.payload_case()) {
      case pb::Request::kHello:
      case pb::Request::kOpen:
      case pb::Request::kClose:
      case pb::Request::kOpenDataset:
        return false;
      default:
        break;
    }
    pb::Reply reply;
    const uint64_t arrays = rng_.Below(10);
    for (uint64_t i = 0; i < arrays; ++i) AddArray(&reply);
    if (rng_.Below(10) == 0) reply.mutable_status()->set_code(static_cast<int>(rng_.Below(20)));
    Frame payload = Frame::OfSize(rng_.Below(700));
    for (size_t i = 0; i < payload.size(); ++i) {
      payload.data()[i] = static_cast<std::byte>(rng_.Below(4));
    }
    server.Reply(call, std::move(reply), std::move(payload));
    return true;
  }

 private:
  void AddArray(pb::Reply* reply) {
    static constexpr const char* kNames[] = {
        "observations", "rewards",     "terminated",         "truncated",     "cause",
        "digests",      "final_lanes", "final_observations", "final_returns", "final_lengths",
        "snapshot",     "qpos",        "next_observations",  "valid",         "actions",
        "terminals",    "indices",     "timeouts",           "time",          "final_lanes"};
    pb::Array* array = reply->add_arrays();
    array->set_name(kNames[rng_.Below(std::size(kNames))]);
    array->set_dtype(static_cast<pb::DType>(1 + rng_.Below(7)));
    array->set_offset(64 * rng_.Below(4));
    for (uint64_t i = rng_.Below(4); i > 0; --i) {
      const uint64_t extents[] = {0, 1, 2, kObservationSize, kActionSize, rng_.NextUint64()};
      array->add_shape(extents[rng_.Below(std::size(extents))]);
    }
  }

  Rng rng_{1, "hostile-replies"};
};

TEST_CASE("no reply of a server crashes a session") {
  FakeDaemon daemon{HostileReplies()};
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  const std::vector<float> actions(2 * kActionSize);
  const std::vector<float> observations(2 * kObservationSize);
  std::vector<float> next(2 * kObservationSize);
  std::vector<double> rewards(2);
  std::vector<uint8_t> terminated(2), valid(2);
  int accepted = 0;
  for (int round = 0; round < kRounds; ++round) {
    Result<RemoteEnvironment> session = client->Make("Fake", {.num_envs = 2});
    REQUIRE(session.ok());
    accepted += session->Reset().ok();
    accepted += session->Step(actions).ok();
    accepted += session->Snapshot().ok();
    accepted += session->Query(observations, actions, {next, rewards, terminated, valid}).ok();
  }
  // A few of the simplest are right by chance; most are not.
  CHECK(accepted > 0);
  CHECK(accepted < kRounds);
}

TEST_CASE("no reply of a server crashes a dataset") {
  FakeDaemon daemon{HostileReplies()};
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  Result<RemoteDataset> dataset = client->OpenDataset("Fake/medium");
  REQUIRE(dataset.ok());
  BatchStream stream = dataset->Stream(4, 1);
  int refused = 0;
  for (int round = 0; round < kRounds; ++round) {
    refused += !dataset->Stats().ok();
    refused += !dataset->Read(0, 4).ok();
    refused += !stream.Next().ok();
  }
  CHECK(refused > 2 * kRounds);
}

TEST_CASE("a benchmark that hides dimensions which its environment lacks is refused") {
  // A catalogue with one benchmark with a dataset and one without; both hide dimension 3 of 0..2.
  const auto hook = [](FakeServer& server, FakeCall& call) {
    pb::Reply reply;
    if (call.request.has_catalogue()) {
      pb::EnvironmentInfo* environment = reply.mutable_catalogue()->add_environments();
      environment->set_name("Fake");
      for (int i = 0; i < 3; ++i) environment->mutable_observation()->add_dimensions();
      environment->mutable_action()->add_dimensions();
      for (const char* dataset : {"", "Fake/medium"}) {
        pb::BenchmarkInfo* benchmark = reply.mutable_catalogue()->add_benchmarks();
        benchmark->set_name(std::string("hiding/") + dataset);
        benchmark->set_environment("Fake");
        benchmark->set_dataset(dataset);
      }
    } else if (call.request.has_ledger()) {
      reply.mutable_ledger()->set_ledger(1);
    } else if (call.request.has_open_dataset()) {
      pb::OpenDatasetReply* open = reply.mutable_open_dataset();
      open->set_fingerprint("f");
      open->set_observation_size(kObservationSize);
      open->set_action_size(kActionSize);
      open->add_hidden_dimensions(3);
    } else {
      return false;
    }
    server.Reply(call, std::move(reply));
    return true;
  };
  FakeDaemon daemon(hook);
  pb::NamedArgument* hidden = daemon.open_reply.add_perturbations();
  hidden->set_name("hidden");
  hidden->set_argument("1+3");
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  for (const auto& [name, message] :
       {std::pair{"hiding/", "dimension is '3', allowed"},
        std::pair{"hiding/Fake/medium", "dimension is 3, allowed: 0..2"}}) {
    CAPTURE(name);
    Result<RemoteBenchmark> bench = client->FindBenchmark(name);
    REQUIRE(bench.ok());
    CHECK_THAT(bench->Mask().status().message(), Catch::Contains(message));
  }
}

}  // namespace
}  // namespace b4mrl
