// Opens between clients that the test plays and workers that it plays as well.
#include "server/gateway/openings.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>

#include "tests/client/fake_server.h"
#include "tests/server/models/compiler_script.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 30'000;

std::string Token(uint64_t number) {
  std::string token(limits::kTokenBytes, 't');
  std::memcpy(token.data(), &number, sizeof(number));
  return token;
}

pb::Request Open(uint64_t id, const std::string& token, uint32_t deadline_ms = 60'000) {
  pb::Request request;
  request.set_request_id(id);
  request.set_session_token(token);
  request.set_deadline_ms(deadline_ms);
  request.mutable_open()->set_environment("HalfCheetah");  // no lanes: for Query alone
  request.mutable_open()->set_seed(1);
  return request;
}

class Fixture {
  SocketFolder folder_;
  Context sockets_;  // outlives the openings
  SharedState state_;

 public:
  explicit Fixture(uint32_t worker_count = 1)
      : state_(Take(SharedState::Create(worker_count, 1'000))) {
    std::vector<DealerSocket> workers;
    for (uint32_t i = 0; i < worker_count; ++i) {
      workers.push_back(Take(DealerSocket::Connect(sockets_, folder_.Address(NameOf(i)))));
    }
    const Openings::Options options{script.options(), {{.tcp = 7701, .ipc = ""}}};
    openings.emplace(state_, std::move(workers), options,
                     [this](const Asker& to, const Result<pb::Reply>& opened) {
                       answers[{to.peer, to.request_id}].push_back(opened.status());
                     });
  }
  template <typename T>
  static T Take(Result<T> result) {
    REQUIRE(result.ok());
    return std::move(*result);
  }

  CompilerScript script;
  std::unique_ptr<FakeServer> worker;  // the one that was started last
  std::optional<Openings> openings;
  std::map<std::pair<RoutingId, uint64_t>, std::vector<Status>> answers;

  // A new process behind the same address; what the old one held is lost.
  void StartWorker() {
    worker.reset();
    worker = std::make_unique<FakeServer>(folder_.Address(NameOf(0)));
  }
  static std::string NameOf(uint32_t index) { return "worker" + std::to_string(index); }
  std::unique_ptr<FakeServer> WorkerOf(uint32_t index) const {
    return std::make_unique<FakeServer>(folder_.Address(NameOf(index)));
  }
  // The worker lacks memory for the session.
  void Refuse(const FakeCall& call) {
    pb::Reply reply;
    SetStatus(Status(StatusCode::kLimitExceeded, "no memory"), reply.mutable_status());
    worker->Reply(call, reply);
  }
  void Ask(const RoutingId& peer, const pb::Request& request) {
    openings->Open({peer, request.request_id()}, request);
  }
  StatusCode AnswerTo(const RoutingId& peer, uint64_t id) {
    const std::vector<Status>& all = answers[{peer, id}];
    REQUIRE(all.size() == 1);
    return all[0].code();
  }
  // The next Attach that the worker gets.
  FakeCall TakeAttach() {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!deadline.expired()) {
      openings->Pump();
      if (std::optional<FakeCall> call = worker->Take(1)) return std::move(*call);
    }
    FAIL("no Attach arrived");
    return {};
  }
  void Attached(const FakeCall& call) {
    pb::Reply reply;
    reply.mutable_attach()->set_experiment_id("experiment");
    worker->Reply(call, reply);
  }
  // Asks for a session of its own with a model of the user's.
  void AskForModel(const RoutingId& peer, uint64_t id, const std::string& file,
                   uint32_t deadline_ms = 60'000) {
    script.Drop(file);
    pb::Request request = Open(id, Token(id), deadline_ms);
    pb::NamedArgument* model = request.mutable_open()->add_perturbations();
    model->set_name("model");
    model->set_argument(file);
    Ask(peer, request);
  }
  // Pumps, as seldom as the gateway would, until the condition holds.
  template <typename Condition>
  void Await(const Condition& holds) {
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (!holds() && !deadline.expired()) PumpOnce();
    REQUIRE(holds());
  }
  void AwaitAnswers() {
    Await([this] { return openings->empty(); });
  }
  StatusCode AwaitAnswerTo(const RoutingId& peer, uint64_t id) {
    Await([&] { return answers.contains({peer, id}); });
    return AnswerTo(peer, id);
  }
  void PumpOnce() {
    std::vector<void*> sockets;
    std::vector<int> descriptors;
    openings->AppendSockets(&sockets);
    openings->AppendDescriptors(&descriptors);
    WaitAnyReadable(sockets, openings->wait_ms(100), descriptors);
    openings->Pump();
  }
};

TEST_CASE("However many Opens of a token wait, its worker is asked once and all are answered") {
  Fixture fixture;
  fixture.StartWorker();
  for (uint64_t id = 1; id <= 100; ++id) fixture.Ask("client", Open(id, Token(1)));
  fixture.Ask("other", Open(7, Token(1)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  for (uint64_t id = 1; id <= 100; ++id) CHECK(fixture.AnswerTo("client", id) == StatusCode::kOk);
  CHECK(fixture.AnswerTo("other", 7) == StatusCode::kOk);
  CHECK_FALSE(fixture.worker->Take(50).has_value());
}

TEST_CASE("A session for which a worker lacks memory goes to the next, until all have refused it") {
  Fixture fixture(/*worker_count=*/2);
  std::unique_ptr<FakeServer> first = fixture.WorkerOf(0), second = fixture.WorkerOf(1);
  fixture.worker = std::move(first);
  fixture.Ask("client", Open(1, Token(1)));
  const FakeCall refused = fixture.TakeAttach();
  fixture.Refuse(refused);
  fixture.Refuse(refused);  // a copy of the answer says nothing of the other worker
  std::swap(fixture.worker, second);
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);

  std::swap(fixture.worker, second);  // which has no session yet, and is asked first
  fixture.Ask("client", Open(2, Token(2)));
  fixture.Refuse(fixture.TakeAttach());
  std::swap(fixture.worker, second);
  fixture.Refuse(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kLimitExceeded);
}

TEST_CASE("A copy of an Open joins it, and another Open of its id is refused") {
  Fixture fixture;
  fixture.StartWorker();
  for (int i = 0; i < 3; ++i) fixture.Ask("client", Open(1, Token(1)));
  fixture.Ask("client", Open(1, Token(2)));
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kInvalidArgument);
  fixture.answers.clear();
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("Opens that wait are bounded, of a connection and of all") {
  Fixture fixture;  // without a worker
  constexpr uint64_t kOfPeer = limits::kMaxPendingOpensOfPeer;
  constexpr uint64_t kPeers = limits::kMaxPendingOpens / kOfPeer;
  for (uint64_t peer = 0; peer < kPeers; ++peer) {
    for (uint64_t id = 0; id < kOfPeer; ++id) {
      fixture.Ask("peer" + std::to_string(peer), Open(id, Token(1)));
    }
    REQUIRE(fixture.answers.empty());
    if (peer > 0) continue;
    fixture.Ask("peer0", Open(kOfPeer, Token(1)));
    REQUIRE(fixture.AnswerTo("peer0", kOfPeer) == StatusCode::kLimitExceeded);
    fixture.answers.clear();
  }
  fixture.Ask("late", Open(1, Token(1)));
  CHECK(fixture.AnswerTo("late", 1) == StatusCode::kLimitExceeded);
  // All of them are answered in the end.
  fixture.StartWorker();
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.answers.size() == limits::kMaxPendingOpens + 1);
  fixture.Ask("late", Open(2, Token(1)));
  CHECK_FALSE(fixture.openings->empty());
}

TEST_CASE("What does not fit into a worker's queue reaches it later") {
  Fixture fixture;
  constexpr uint64_t kSessions = limits::kMaxSessions;
  static_assert(kSessions > limits::kHighWaterMark);
  for (uint64_t i = 0; i < kSessions; ++i) {
    fixture.Ask("peer" + std::to_string(i / 100), Open(i, Token(i)));
  }
  fixture.openings->Pump();
  fixture.StartWorker();
  for (uint64_t i = 0; i < kSessions; ++i) fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  REQUIRE(fixture.answers.size() == kSessions);
  for (const auto& [asker, answers] : fixture.answers) {
    REQUIRE(answers.size() == 1);
    REQUIRE(answers[0].ok());
  }
}

TEST_CASE("An Open whose worker is silent is answered at its deadline") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1), 60'000));
  fixture.Ask("client", Open(2, Token(1), 50));
  CHECK(fixture.openings->wait_ms(100) <= 50);
  const Deadline deadline = Deadline::AfterMs(kPatienceMs);
  while (fixture.answers.empty() && !deadline.expired()) fixture.PumpOnce();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kDeadlineExceeded);
  CHECK(fixture.openings->wait_ms(100) == 100);  // the loop need not turn for the other
  const FakeCall attach = fixture.TakeAttach();
  fixture.Attached(attach);
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("A worker is not asked again for what it has not answered yet") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1), 1));
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kDeadlineExceeded);
  fixture.Ask("client", Open(2, Token(1)));
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 2) == StatusCode::kOk);
  CHECK_FALSE(fixture.worker->Take(50).has_value());
}

TEST_CASE("A replaced worker is asked again, however often it is replaced") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.Ask("client", Open(1, Token(1)));
  for (int i = 0; i < 4; ++i) {
    fixture.TakeAttach();
    fixture.StartWorker();
  }
  fixture.Attached(fixture.TakeAttach());
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("client", 1) == StatusCode::kOk);
}

TEST_CASE("An Open whose model is compiled for too long is answered at its deadline") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.AskForModel("patient", 1, "good.xml", 20'000);
  fixture.AskForModel("hurried", 2, "slow.xml", 50);
  const FakeCall attach = fixture.TakeAttach();
  fixture.Attached(attach);
  fixture.AwaitAnswers();
  CHECK(fixture.AnswerTo("patient", 1) == StatusCode::kOk);
  CHECK(fixture.AnswerTo("hurried", 2) == StatusCode::kDeadlineExceeded);
}

TEST_CASE("Models that never end do not keep another connection's waiting") {
  Fixture fixture;
  fixture.StartWorker();
  for (uint64_t i = 1; i <= 2 * limits::kModelCompilers; ++i) {
    const std::string name = "slow" + std::to_string(i);
    fixture.AskForModel(name, i, name + ".xml");
  }
  fixture.Await([&] { return fixture.script.runs() >= limits::kModelCompilers; });
  fixture.AskForModel("other", 100, "good.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("other", 100) == StatusCode::kOk);
  CHECK(fixture.answers.size() == 1);  // those that made room still wait
  fixture.AskForModel("other", 101, "refused.xml");
  CHECK(fixture.AwaitAnswerTo("other", 101) == StatusCode::kInvalidArgument);
}

TEST_CASE("The model of a live session stays marked as used") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.AskForModel("client", 1, "good.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("client", 1) == StatusCode::kOk);
  const std::filesystem::path model = ModelCacheFolder(fixture.script.options().data_folder) +
                                      "/00000000000000000000000000000001.mjb";
  const auto long_ago = std::filesystem::last_write_time(model) - std::chrono::hours(24);
  std::filesystem::last_write_time(model, long_ago);
  fixture.openings->Reap();
  CHECK(std::filesystem::last_write_time(model) > long_ago + std::chrono::hours(23));
}

TEST_CASE("A connection's models are compiled one after another, beside those of others") {
  Fixture fixture;
  fixture.StartWorker();
  for (uint64_t i = 1; i <= 4; ++i) {
    fixture.AskForModel("greedy", i, "slow" + std::to_string(i) + ".xml");
  }
  fixture.AskForModel("other", 100, "good.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("other", 100) == StatusCode::kOk);
  CHECK(fixture.script.runs() <= 2);  // one of theirs may not have come to its line yet
}

TEST_CASE("Models that wait are bounded, of a connection and of all") {
  Fixture fixture;
  uint64_t id = 0;
  const auto ask = [&](const RoutingId& peer, uint32_t deadline_ms = 60'000) {
    ++id;
    fixture.AskForModel(peer, id, "slow" + std::to_string(id) + ".xml", deadline_ms);
    return fixture.answers.contains({peer, id}) ? fixture.AnswerTo(peer, id) : StatusCode::kOk;
  };
  for (uint32_t i = 0; i < limits::kMaxPendingModelsOfPeer; ++i) {
    REQUIRE(ask("greedy") == StatusCode::kOk);
  }
  CHECK(ask("greedy") == StatusCode::kLimitExceeded);
  for (uint32_t i = limits::kMaxPendingModelsOfPeer; i + 1 < limits::kMaxPendingModels; ++i) {
    REQUIRE(ask("peer" + std::to_string(i)) == StatusCode::kOk);
  }
  REQUIRE(ask("hurried", 1) == StatusCode::kOk);
  const uint64_t hurried = id;
  CHECK(ask("late") == StatusCode::kLimitExceeded);
  CHECK(fixture.AwaitAnswerTo("hurried", hurried) == StatusCode::kDeadlineExceeded);
  fixture.openings->Pump();
  CHECK(ask("late") == StatusCode::kOk);  // in the place of what nobody waits for any more
}

TEST_CASE("A model that nobody waits for any more is not compiled") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.AskForModel("a", 1, "slow.xml");
  fixture.AskForModel("a", 2, "good1.xml", 1);
  CHECK(fixture.AwaitAnswerTo("a", 2) == StatusCode::kDeadlineExceeded);
  fixture.AskForModel("b", 3, "good2.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("b", 3) == StatusCode::kOk);
  CHECK(fixture.script.runs("good1.xml") == 0);
}

TEST_CASE("A session that is closed while its model is compiled is not opened") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.AskForModel("a", 1, "slow.xml");
  fixture.AskForModel("a", 2, "good1.xml");
  fixture.openings->Close(Token(2));
  CHECK(fixture.AnswerTo("a", 2) == StatusCode::kSessionLost);
  fixture.AskForModel("b", 3, "good2.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("b", 3) == StatusCode::kOk);
  CHECK(fixture.script.runs("good1.xml") == 0);
}

TEST_CASE("An Open of the greatest size has room for the path of its compiled model") {
  Fixture fixture;
  fixture.StartWorker();
  fixture.script.Drop("good.xml");
  pb::Request request = Open(1, Token(1));
  pb::OpenRequest* open = request.mutable_open();
  open->add_perturbations()->set_name("model");
  open->mutable_perturbations(0)->set_argument("good.xml");
  while (open->ByteSizeLong() < limits::kMaxOpenRequestBytes) *open->mutable_config() += ' ';
  fixture.Ask("a", request);
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("a", 1) == StatusCode::kOk);
}

TEST_CASE("Names that no model file can have, and unknown environments, are refused at once") {
  Fixture fixture;
  fixture.AskForModel("a", 1, "no.txt");
  CHECK(fixture.AnswerTo("a", 1) == StatusCode::kInvalidArgument);
  pb::Request request = Open(2, Token(2));
  request.mutable_open()->set_environment("Hoper");
  pb::NamedArgument* model = request.mutable_open()->add_perturbations();
  model->set_name("model");
  model->set_argument("good.xml");
  fixture.Ask("a", request);
  CHECK(fixture.AnswerTo("a", 2) == StatusCode::kUnknownName);
}

}  // namespace
}  // namespace b4mrl
