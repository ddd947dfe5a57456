#include "client/remote_dataset.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <deque>
#include <vector>

#include "client/client.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

class Opened {
 public:
  explicit Opened(FakeDaemon& daemon) {
    Result<Client> client = Client::Connect(daemon.address());
    REQUIRE(client.ok());
    client_.emplace(std::move(*client));
    Result<RemoteDataset> dataset = client_->OpenDataset("Fake/medium");
    INFO(dataset.status().ToString());
    REQUIRE(dataset.ok());
    dataset_.emplace(std::move(*dataset));
  }
  RemoteDataset* operator->() { return &*dataset_; }

 private:
  std::optional<Client> client_;
  std::optional<RemoteDataset> dataset_;
};

TEST_CASE("a dataset says in which environment it was recorded") {
  FakeDaemon daemon;
  CHECK(Opened(daemon)->environment() == "Fake");
}

TEST_CASE("a stream delivers batches in order and keeps its credits ahead") {
  constexpr uint32_t kCredits = 3;
  // Answers a request only when as many wait as there are credits.
  std::deque<FakeCall> waiting;
  FakeDaemon* daemon_in_hook = nullptr;
  FakeDaemon daemon([&](FakeServer& server, FakeCall& call) {
    if (!call.request.has_sample()) return false;
    waiting.push_back(std::move(call));
    if (waiting.size() < kCredits) return true;
    daemon_in_hook->Answer(server, waiting.front());
    waiting.pop_front();
    return true;
  });
  daemon_in_hook = &daemon;
  Opened dataset(daemon);
  BatchStream stream = dataset->Stream(/*rows=*/8, /*seed=*/1, /*first_batch=*/5, kCredits);
  for (uint64_t batch = 5; batch < 10; ++batch) {
    CHECK(stream.next_batch() == batch);
    const Result<TransitionRows> rows = stream.Next();
    INFO(rows.status().ToString());
    REQUIRE(rows.ok());
    CHECK(rows->rows == 8);
    CHECK(rows->rewards[7] == static_cast<float>(batch));
  }
}

TEST_CASE("small batches that share a reply are told apart and outlive their stream") {
  std::vector<uint64_t> firsts;
  FakeDaemon daemon([&firsts](FakeServer&, FakeCall& call) {
    if (call.request.has_sample()) {
      firsts.push_back(call.request.sample().first_batch());
      CHECK(call.request.sample().batches() == 4);
    }
    return false;
  });
  std::vector<TransitionRows> batches;
  {
    Opened dataset(daemon);
    BatchStream first = dataset->Stream(/*rows=*/5, /*seed=*/1, /*first_batch=*/0, /*credits=*/8);
    for (int i = 0; i < 6; ++i) {
      Result<TransitionRows> batch = first.Next();
      REQUIRE(batch.ok());
      batches.push_back(std::move(*batch));
    }
    BatchStream moved = std::move(first);  // in the middle of a reply
    for (int i = 0; i < 7; ++i) {
      Result<TransitionRows> batch = moved.Next();
      REQUIRE(batch.ok());
      batches.push_back(std::move(*batch));
    }
    CHECK(moved.next_batch() == 13);
  }
  for (size_t b = 0; b < batches.size(); ++b) {
    const TransitionRows& batch = batches[b];
    CHECK(batch.first_batch == b);
    CHECK(batch.rows == 5);
    REQUIRE(batch.observations.size() == 5 * kObservationSize);
    REQUIRE(batch.actions.size() == 5 * kActionSize);
    for (const std::span<const float> column :
         {batch.observations, batch.actions, batch.rewards, batch.next_observations}) {
      CHECK(std::ranges::count(column, static_cast<float>(b)) ==
            static_cast<std::ptrdiff_t>(column.size()));
    }
  }
  for (size_t i = 0; i < firsts.size(); ++i) CHECK(firsts[i] == 4 * i);
}

TEST_CASE("large batches come one at a time") {
  std::atomic<uint32_t> most{0};
  FakeDaemon daemon([&most](FakeServer&, FakeCall& call) {
    if (call.request.has_sample()) most = std::max<uint32_t>(most, call.request.sample().batches());
    return false;
  });
  Opened dataset(daemon);
  BatchStream stream = dataset->Stream(limits::kMaxRowsPerBatch, 1, 0, /*credits=*/4);
  const Result<TransitionRows> rows = stream.Next();
  REQUIRE(rows.ok());
  CHECK(rows->rows == limits::kMaxRowsPerBatch);
  CHECK(most == 1);
}

TEST_CASE("a large batch is a view into the frame that was received") {
  FakeDaemon daemon;
  Opened dataset(daemon);
  // Smaller messages share ZeroMQ's receive buffer, at odd addresses, and are copied once.
  constexpr uint32_t kRows = 1000;
  Result<TransitionRows> received = dataset->Sample(kRows, 0, 4);
  REQUIRE(received.ok());
  const TransitionRows rows = std::move(*received);  // moving keeps the views
  const auto* begin = reinterpret_cast<const std::byte*>(rows.observations.data());
  CHECK(begin >= rows.reply->payload.data());
  CHECK(begin < rows.reply->payload.data() + rows.reply->payload.size());
  CHECK(rows.observations.size() == kRows * kObservationSize);
  CHECK(rows.actions.size() == kRows * kActionSize);
  CHECK(rows.next_observations[0] == 4.0f);
}

TEST_CASE("after an error a stream asks for the same batch again") {
  std::atomic<bool> refuse{true};
  FakeDaemon daemon([&refuse](FakeServer& server, FakeCall& call) {
    if (!call.request.has_sample() || call.request.sample().first_batch() != 2 ||
        !refuse.exchange(false)) {
      return false;
    }
    server.ReplyError(call, Status(StatusCode::kUnavailable, "the daemon is stopping"));
    return true;
  });
  Opened dataset(daemon);
  BatchStream stream = dataset->Stream(4, 1);
  REQUIRE(stream.Next().ok());
  REQUIRE(stream.Next().ok());
  CHECK(stream.Next().status().code() == StatusCode::kUnavailable);
  const Result<TransitionRows> again = stream.Next();
  REQUIRE(again.ok());
  CHECK(again->rewards[0] == 2.0f);
}

TEST_CASE("a stream that ends gives back its credits") {
  FakeDaemon daemon;
  Opened dataset(daemon);
  for (uint32_t i = 0; i < 2 * limits::kMaxRequestsInFlight; ++i) {
    BatchStream stream = dataset->Stream(4, 1, i, /*credits=*/8);
    const Result<TransitionRows> rows = stream.Next();
    INFO(rows.status().ToString());
    REQUIRE(rows.ok());
    CHECK(rows->rewards[0] == static_cast<float>(i));
  }
}

TEST_CASE("no credit at all still delivers") {
  FakeDaemon daemon;
  Opened dataset(daemon);
  BatchStream stream = dataset->Stream(4, 1, 0, /*credits=*/0);
  CHECK(stream.Next().ok());
}

TEST_CASE("statistics that do not fit the dataset are a fault of the server") {
  FakeDaemon daemon([](FakeServer& server, FakeCall& call) {
    if (!call.request.has_dataset_stats()) return false;
    server.Reply(call);
    return true;
  });
  Opened dataset(daemon);
  CHECK(dataset->Stats().status().code() == StatusCode::kInternal);
}

TEST_CASE("a dataset whose name is not UTF-8 is refused at once") {
  FakeDaemon daemon;
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  CHECK(client->OpenDataset("caf\xe9/medium").status().code() == StatusCode::kInvalidArgument);
}

TEST_CASE("rows that do not fit the dataset are a fault of the server") {
  FakeDaemon daemon([](FakeServer& server, FakeCall& call) {
    if (!call.request.has_sample()) return false;
    pb::Reply reply;
    ArrayLayout layout(reply.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {1, kObservationSize + 1});
    server.Reply(call, std::move(reply), layout.Allocate());
    return true;
  });
  Opened dataset(daemon);
  CHECK(dataset->Sample(1, 0, 0).status().code() == StatusCode::kInternal);
}

TEST_CASE("a reply must have the rows that were asked for, and no more than the dataset has") {
  std::atomic<uint64_t> rows{0};
  FakeDaemon daemon([&rows](FakeServer& server, FakeCall& call) {
    if (!call.request.has_sample() && !call.request.has_read()) return false;
    pb::Reply reply;
    ArrayLayout layout(reply.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {rows, kObservationSize});
    layout.Add("actions", DType::kFloat32, {rows, kActionSize});
    layout.Add("rewards", DType::kFloat32, {rows});
    layout.Add("next_observations", DType::kFloat32, {rows, kObservationSize});
    layout.Add("terminals", DType::kUint8, {rows});
    server.Reply(call, std::move(reply), layout.Allocate());
    return true;
  });
  Opened dataset(daemon);
  for (const uint64_t answered : {0, 5, 7, 12}) {
    rows = answered;
    CHECK(dataset->Sample(6, 0, 0).status().code() == StatusCode::kInternal);
    CHECK(dataset->Read(0, 6).status().code() == StatusCode::kInternal);
  }
  rows = 12;
  CHECK(dataset->Sample(6, 0, 0, /*batches=*/2).ok());
  CHECK(dataset->Read(0, 12).ok());
  // The dataset has 100 rows: only 4 are left behind the first 96.
  CHECK(dataset->Read(96, 12).status().code() == StatusCode::kInternal);
  rows = 4;
  CHECK(dataset->Read(96, 12)->rows == 4);
}

TEST_CASE("a dataset with more rows than any can have is refused") {
  FakeDaemon daemon;
  daemon.dataset_rows = limits::kMaxDatasetRows + 1;
  Result<Client> client = Client::Connect(daemon.address());
  REQUIRE(client.ok());
  CHECK(client->OpenDataset("Fake/medium").status().code() == StatusCode::kInternal);
}

}  // namespace
}  // namespace b4mrl
