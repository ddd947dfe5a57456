// What the clients of one worker notice of each other, and of their deadlines. The short cases pass
// on a machine on which twenty other programs compute, and fail where somebody has to wait for
// others' requests; those tagged [long] are the proofs, for a machine with nothing else to do.
#include <catch2/catch.hpp>
#include <map>
#include <string>
#include <vector>

#include "client/connection.h"
#include "proto/base/limits.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/worker_load.h"

namespace b4mrl {
namespace {

PrivateDaemon StartWorker() {
  return StartDaemon({.tcp = true, .arguments = {"--workers", "1", "--threads", "2"}});
}

// Long enough for a load to spread through the worker.
void LetItSpread(Client& client) {
  RemoteEnvironment probe = Take(client.Make("HalfCheetah"));
  RequireOk(probe.Reset().status());
  (void)StepFor(probe, 1);
}

// ---- Whose turn it is ---------------------------------------------------------------------------

void AskBesideSteps(int times, double most_times_idle) {
  PrivateDaemon daemon = StartWorker();
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment session = Take(client.Make("HalfCheetah", {.num_envs = 64, .seed = 1}));
  RequireOk(session.Reset().status());
  SmallQueries queries(client);
  const auto take_snapshot = [&] { RequireOk(session.Snapshot().status()); };
  const double idle_query = queries.MedianMs(times);
  const double idle_snapshot = MedianMs(times, take_snapshot);
  const auto first = StepHumanoids(daemon.endpoint());
  const auto second = StepHumanoids(daemon.endpoint());
  LetItSpread(client);
  const double query = queries.MedianMs(times), snapshot = MedianMs(times, take_snapshot);
  UNSCOPED_INFO("idle, then beside two clients with 1,024 steps in flight, ms: query "
                << idle_query << ", " << query << "; snapshot " << idle_snapshot << ", "
                << snapshot);
  CHECK(query < most_times_idle * idle_query);
  CHECK(snapshot < most_times_idle * idle_snapshot);
  RequireOk(first->Stop());
  RequireOk(second->Stop());
}

TEST_CASE("Queries and snapshots get their turn beside clients that fill the worker with steps") {
  AskBesideSteps(20, 100);
}

TEST_CASE("A query beside full steps takes at most ten times as long as alone", "[.][long]") {
  AskBesideSteps(100, 10);
}

void StepBesideCostlyRows(int in_flight, int64_t deadline_ms, double seconds, double least_rate,
                          double most_p99_ms) {
  PrivateDaemon daemon = StartWorker();
  Client client = Connect(daemon.endpoint());
  RemoteEnvironment session = Take(client.Make("HalfCheetah", {.seed = 1}));
  RequireOk(session.Reset().status());
  (void)StepFor(session, seconds / 4);  // the first steps are slower
  const Pace alone = StepFor(session, seconds);
  std::vector<std::unique_ptr<Load>> loads;
  for (int i = 0; i < 4; ++i)
    loads.push_back(AskCostlyRows(daemon.endpoint(), in_flight, deadline_ms));
  LetItSpread(client);
  const Pace beside = StepFor(session, seconds);
  const double snapshot = MedianMs(20, [&] { RequireOk(session.Snapshot().status()); });
  const double query = SmallQueries(client).MedianMs(20);
  UNSCOPED_INFO("alone, then beside four clients with costly queries: "
                << alone.steps_per_second << ", " << beside.steps_per_second
                << " steps a second, p99 " << alone.p99_ms << ", " << beside.p99_ms
                << " ms; snapshot " << snapshot << " ms, query " << query << " ms");
  CHECK(beside.steps_per_second > least_rate * alone.steps_per_second);
  CHECK(beside.p99_ms < most_p99_ms);
  CHECK(snapshot < 1'000);
  CHECK(query < 1'000);
  for (const auto& load : loads) load->Halt();
  for (const auto& load : loads) RequireOk(load->Stop());
}

TEST_CASE("A client that steps does not wait for costly queries of others") {
  // Where steps wait for costly rows, a hundredth of the rate is left, and p99 is above a second.
  StepBesideCostlyRows(2, 3'000, 2, 0.02, 500);
}

TEST_CASE("Sixty-four costly queries leave a client that steps four tenths of its rate",
          "[.][long]") {
  StepBesideCostlyRows(16, limits::kDefaultDeadlineMs, 10, 0.4, 50);
}

TEST_CASE("Costly queries do not halve the rate of a client with full steps", "[.][long]") {
  PrivateDaemon daemon = StartWorker();
  Client client = Connect(daemon.endpoint());
  const auto steps = StepHumanoids(daemon.endpoint());
  LetItSpread(client);
  const double alone = steps->RateFor(10);
  const auto queries = AskCostlyRows(daemon.endpoint(), 16, limits::kDefaultDeadlineMs);
  LetItSpread(client);
  const double beside = steps->RateFor(10);
  UNSCOPED_INFO("alone, then beside 16 costly queries: " << alone << ", " << beside
                                                         << " requests a second");
  CHECK(beside > 0.5 * alone);
  queries->Halt();
  RequireOk(steps->Stop());
  RequireOk(queries->Stop());
}

// ---- Deadlines ----------------------------------------------------------------------------------

// A session for queries, message by message, so that a test sees when the server itself answers.
class QuerySession {
 public:
  QuerySession(Context& context, const std::string& endpoint) {
    Connection gateway = Take(Connection::Open(context, endpoint, token_));
    pb::Request open;
    open.mutable_open()->set_environment("Humanoid");
    const ReceivedReply opened =
        Take(gateway.Call(std::move(open), Frame(), Deadline::AfterMs(20'000)));
    const uint32_t port = opened.envelope.open().port().tcp();
    socket_ = std::make_unique<DealerSocket>(
        Take(DealerSocket::Connect(context, "tcp://127.0.0.1:" + std::to_string(port))));
  }

  // A query that takes half a minute.
  void Send(uint64_t id, uint32_t deadline_ms) {
    pb::Request request;
    request.set_protocol_version(limits::kProtocolVersion);
    request.set_session_token(token_);
    request.set_request_id(id);
    request.set_deadline_ms(deadline_ms);
    request.mutable_query();
    ArrayLayout layout(request.mutable_arrays());
    layout.Add("observations", DType::kFloat32, {limits::kMaxQueryRows, 376});
    layout.Add("actions", DType::kFloat32, {limits::kMaxQueryRows, 17});
    if (payload_.size() == 0) {
      payload_ = layout.Allocate();
      std::fill_n(payload_.data(), payload_.size(), std::byte());
    }
    RequireOk(socket_->Send({Take(SerializeEnvelope(request)), payload_.Share()}));
  }
  pb::Reply Receive() {
    std::optional<Message> message;
    const Deadline patience = Deadline::AfterMs(60'000);
    while (!message && !patience.expired()) message = socket_->Receive(patience);
    REQUIRE(message);
    pb::Reply reply;
    RequireOk(ParseEnvelope(message->envelope, &reply));
    return reply;
  }

 private:
  const std::string token_ = std::string(limits::kTokenBytes, 'q');
  std::unique_ptr<DealerSocket> socket_;
  Frame payload_;
};

// How long after its deadline each of `count` queries was answered, ms, 20 in flight.
std::vector<double> LatenessOf(QuerySession& session, uint64_t count) {
  constexpr uint64_t kInFlight = 20;
  constexpr uint32_t kDeadlineMs = 500;
  std::map<uint64_t, Deadline> deadlines;
  std::vector<double> lateness;
  for (uint64_t id = 1; lateness.size() < count;) {
    for (; id <= count && deadlines.size() < kInFlight; ++id) {
      session.Send(id, kDeadlineMs);
      deadlines.emplace(id, Deadline::AfterMs(kDeadlineMs));
    }
    const pb::Reply reply = session.Receive();
    REQUIRE(GetStatus(reply.status()).code() == StatusCode::kDeadlineExceeded);
    lateness.push_back(1e3 * SecondsSince(deadlines.at(reply.request_id()).at()));
    deadlines.erase(reply.request_id());
  }
  std::ranges::sort(lateness);
  return lateness;
}

void KeepDeadlines(uint64_t count, double most_ms, double all_ms) {
  PrivateDaemon daemon = StartWorker();
  Client client = Connect(daemon.endpoint());
  const auto first = StepHumanoids(daemon.endpoint());
  const auto second = StepHumanoids(daemon.endpoint());
  LetItSpread(client);
  Context context;
  QuerySession session(context, daemon.endpoint());
  const std::vector<double> lateness = LatenessOf(session, count);
  UNSCOPED_INFO("ms after the deadline: median " << Median(lateness) << ", 99 of 100 within "
                                                 << lateness[count * 99 / 100 - 1]
                                                 << ", all within " << lateness.back());
  CHECK(lateness[count * 99 / 100 - 1] < most_ms);
  CHECK(lateness.back() < all_ms);
  RequireOk(first->Stop());
  RequireOk(second->Stop());
}

TEST_CASE("A request that the worker does not get done is answered at its deadline") {
  KeepDeadlines(100, 5'000, 10'000);
}

TEST_CASE("A thousand deadlines beside full steps are kept within 0.2 s", "[.][long]") {
  KeepDeadlines(1000, 200, 1'000);
}

}  // namespace
}  // namespace b4mrl
