// Opens whose users' models are compiled first.
#include "server/gateway/openings.h"

#include <catch2/catch.hpp>
#include <chrono>
#include <filesystem>
#include <string>

#include "tests/server/gateway/openings_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("An Open whose model is compiled for too long is answered at its deadline") {
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
  fixture.StartWorker();
  fixture.AskForModel("client", 1, "good.xml");
  fixture.Attached(fixture.TakeAttach());
  CHECK(fixture.AwaitAnswerTo("client", 1) == StatusCode::kOk);
  const std::filesystem::path model = ModelCacheFolder(fixture.script.options().data_folder) +
                                      "/00000000000000000000000000000001.mjb";
  const auto long_ago = std::filesystem::last_write_time(model) - std::chrono::hours(24);
  std::filesystem::last_write_time(model, long_ago);
  fixture.openings->Reap();
  const auto is_recent = [&] {
    return std::filesystem::last_write_time(model) > long_ago + std::chrono::hours(23);
  };
  fixture.Await(is_recent);
}

TEST_CASE("A connection's models are compiled one after another, beside those of others") {
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
  OpeningsFixture fixture;
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
