// Raw bytes where ZeroMQ's handshake, frames and messages should be.
#include <catch2/catch.hpp>
#include <filesystem>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/raw_zmtp.h"

namespace b4mrl {
namespace {

constexpr int kConnections = 2'000;
constexpr int64_t kPatienceMs = 20'000;

class HostileConnections {
 public:
  HostileConnections() {
    addresses_ = {daemon_.endpoint(), Loopback(environment_.in_force().port()),
                  Loopback(client_.hello().dataset_port())};
  }

  // Of the gateway, the worker and the dataset worker.
  const std::vector<std::string>& addresses() const { return addresses_; }

  void RequireUnharmed() {
    const pb::ServerStatusReply status = Take(client_.ServerStatus());
    for (const pb::WorkerStatus& child : status.workers()) REQUIRE(child.restarts() == 0);
    REQUIRE(environment_.Reset().ok());
    REQUIRE(client_.ListDatasets().ok());
  }

 private:
  static std::string Loopback(const pb::Port& port) {
    return "tcp://127.0.0.1:" + std::to_string(port.tcp());
  }

  PrivateDaemon daemon_ =
      StartDaemon({.tcp = true, .arguments = {"--workers", "1", "--threads", "1"}});
  Client client_ = Connect(daemon_.endpoint());
  RemoteEnvironment environment_ = Take(client_.Make("HalfCheetah"));
  std::vector<std::string> addresses_;
};

std::string RandomBytes(Rng& rng, size_t size) {
  std::string bytes(size, '\0');
  for (char& byte : bytes) byte = static_cast<char>(rng.Below(256));
  return bytes;
}

// Bytes that begin as a correct conversation would, and go wrong at a random place.
std::string SpoiltConversation(Rng& rng) {
  std::string bytes = RawZmtp::Greeting() + RawZmtp::Ready();
  for (int i = 0; i < 3; ++i) {
    bytes +=
        RawZmtp::FrameOf(RandomBytes(rng, rng.Below(400)), rng.Below(2) == 0, rng.Below(8) == 0);
  }
  const size_t place = rng.Below(bytes.size());
  switch (rng.Below(4)) {
    case 0:
      return bytes.substr(0, place);
    case 1:
      return bytes.substr(0, place) + RandomBytes(rng, rng.Below(200));
    case 2:
      bytes[place] = static_cast<char>(rng.Below(256));
      return bytes;
    default:
      return RandomBytes(rng, rng.Below(300));
  }
}

TEST_CASE("Connections that speak garbage harm nobody else's") {
  HostileConnections daemon;
  Rng rng(1, "garbage");
  for (int i = 0; i < kConnections; ++i) {
    RawZmtp connection(daemon.addresses()[rng.Below(3)]);
    REQUIRE(connection.connected());
    // The peer may hang up in the middle; whether it does is its own affair.
    (void)connection.SendBytes(SpoiltConversation(rng));
  }
  daemon.RequireUnharmed();
}

TEST_CASE("Messages of too many parts are answered with an error, and the connection lives") {
  HostileConnections daemon;
  for (const std::string& address : daemon.addresses()) {
    RawZmtp connection(address);
    REQUIRE(connection.ShakeHands());
    for (const size_t parts : {3, 4, 100}) {
      CAPTURE(address, parts);
      REQUIRE(connection.SendMessage(std::vector<std::string>(parts, "part")));
      const std::vector<std::string> reply = connection.Receive(kPatienceMs);
      REQUIRE(reply.size() == 1);
      pb::Reply envelope;
      REQUIRE(envelope.ParseFromString(reply[0]));
      REQUIRE(envelope.status().code() != 0);
    }
    pb::Request request;
    request.set_protocol_version(limits::kProtocolVersion);
    request.set_request_id(5);
    REQUIRE(connection.SendMessage({request.SerializeAsString()}));
    const std::vector<std::string> reply = connection.Receive(kPatienceMs);
    REQUIRE(reply.size() == 1);
    pb::Reply envelope;
    REQUIRE(envelope.ParseFromString(reply[0]));
    REQUIRE(envelope.request_id() == 5);
  }
  daemon.RequireUnharmed();
}

TEST_CASE("A peer that claims the numbers that ZeroMQ gives to others ends no process") {
  HostileConnections daemon;
  // ZeroMQ numbers peers without an identity from rand() on, whose first value nobody may know.
  constexpr uint32_t kFirstUnseeded = 0x6b8b4567;
  for (const std::string& address : daemon.addresses()) {
    std::vector<RawZmtp> claims;
    for (uint32_t i = 0; i < 64; ++i) {
      std::string identity(1, '\0');
      for (int shift = 24; shift >= 0; shift -= 8) {
        identity += static_cast<char>((kFirstUnseeded + i) >> shift);
      }
      claims.emplace_back(address);
      REQUIRE(claims.back().ShakeHands(identity));
    }
    RawZmtp ordinary(address);
    REQUIRE(ordinary.ShakeHands());
    REQUIRE(ordinary.SendMessage({"no envelope"}));
    REQUIRE_FALSE(ordinary.Receive(kPatienceMs).empty());
  }
  daemon.RequireUnharmed();
}

TEST_CASE("A message that never ends costs the process that takes it, and nobody else's memory") {
  const PrivateDaemon daemon = StartDaemon(
      {.tcp = true, .arguments = {"--workers", "1", "--threads", "1", "--memory", "200"}});
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment environment = Take(client.Make("HalfCheetah"));
  REQUIRE(environment.Reset().ok());
  RawZmtp connection(daemon.endpoint());
  REQUIRE(connection.ShakeHands());
  const std::string part = RawZmtp::FrameOf(std::string(1 << 20, 'x'), /*more=*/true);
  int parts = 0;
  while (parts < 4'000 && connection.SendBytes(part)) ++parts;
  REQUIRE(parts > 100);
  REQUIRE(parts < 4'000);
  REQUIRE(environment.Reset().ok());
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& child : status.workers()) {
    CHECK(child.restarts() == (child.role() == "gateway" ? 1 : 0));
  }
}

TEST_CASE("A client that reads no replies does not bring a daemon with little memory to its end") {
  constexpr uint64_t kMemoryMib = 200;
  constexpr uint32_t kRows = 16'384;
  constexpr uint64_t kReplyBytes = kRows * 4 * (17 + 6 + 1 + 17);
  const TemporaryFolder data;
  std::filesystem::create_directories(data.File("Example"));
  REQUIRE(WriteExample(data.File("Example/small.h5"), MakeExampleDataset({400, 500}, 17, 6)).ok());
  const PrivateDaemon daemon = StartDaemon(
      {.tcp = true,
       .data_folder = data.path(),
       .arguments = {"--workers", "1", "--threads", "1", "--memory", std::to_string(kMemoryMib)}});
  Client client = Connect(daemon.endpoint());
  RemoteDataset dataset = Take(client.OpenDataset("Example/small"));
  RawZmtp deaf("tcp://127.0.0.1:" + std::to_string(client.hello().dataset_port().tcp()));
  REQUIRE(deaf.ShakeHands());
  pb::Request sample;
  sample.set_protocol_version(limits::kProtocolVersion);
  sample.set_deadline_ms(kPatienceMs);
  sample.mutable_sample()->set_fingerprint(dataset.fingerprint());
  sample.mutable_sample()->set_batches(1);
  sample.mutable_sample()->set_rows(kRows);
  // Turn by turn with another client, whose requests are answered.
  for (uint64_t i = 1; i * kReplyBytes < 2 * kMemoryMib << 20; ++i) {
    sample.set_request_id(i);
    REQUIRE(deaf.SendMessage({sample.SerializeAsString()}));
    REQUIRE(dataset.Sample(kRows, /*seed=*/1, /*first_batch=*/i).ok());
  }
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& child : status.workers()) CHECK(child.restarts() == 0);
}

TEST_CASE("A peer that answers no heartbeat is given up after six seconds, not before") {
  HostileConnections daemon;
  std::vector<RawZmtp> silent;
  const Clock::time_point start = Clock::now();
  for (const std::string& address : daemon.addresses()) {
    REQUIRE(silent.emplace_back(address).ShakeHands());
  }
  for (RawZmtp& connection : silent) {
    CHECK(connection.AwaitHangUp(kPatienceMs));
    CHECK(SecondsSince(start) > 1e-3 * limits::kHeartbeatTimeoutMs);
  }
  daemon.RequireUnharmed();
}

// ZMTP's announcement of a frame of `size` bytes.
std::string LongFrameHeader(uint64_t size) {
  std::string header = "\x02";
  for (int shift = 56; shift >= 0; shift -= 8) header += static_cast<char>(size >> shift);
  return header;
}

TEST_CASE("A frame above the limit ends its connection before it is received") {
  HostileConnections daemon;
  for (const std::string& address : daemon.addresses()) {
    // Long frames whose bytes never come: the announcement alone decides.
    RawZmtp largest(address), larger(address);
    REQUIRE(largest.ShakeHands());
    REQUIRE(largest.SendBytes(LongFrameHeader(limits::kMaxPayloadBytes)));
    REQUIRE(larger.ShakeHands());
    REQUIRE(larger.SendBytes(LongFrameHeader(limits::kMaxPayloadBytes + 1)));
    REQUIRE(larger.AwaitHangUp(kPatienceMs));
    REQUIRE_FALSE(largest.HasHungUp());  // though its announcement came first
  }
  daemon.RequireUnharmed();
}

}  // namespace
}  // namespace b4mrl
