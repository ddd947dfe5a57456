// Render as a worker answers it.
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>

#include "tests/server/worker/worker_fixture.h"

namespace b4mrl {
namespace {

constexpr uint32_t kSide = 64;
// A painter that starts on a busy machine takes its time.
constexpr uint32_t kPatientMs = 120'000;

pb::Request RenderRequest(uint32_t width = kSide, uint32_t height = kSide) {
  pb::Request request;
  request.set_deadline_ms(kPatientMs);
  request.mutable_render()->set_width(width);
  request.mutable_render()->set_height(height);
  return request;
}

std::string FrameOf(const Answer& answer, size_t lane) {
  REQUIRE(answer.code() == StatusCode::kOk);
  const size_t bytes = size_t{3} * kSide * kSide;
  return answer.payload.substr(lane * bytes, bytes);
}

std::vector<uint64_t> ShapeOf(const Answer& answer) {
  INFO(answer.envelope.status().message());
  REQUIRE(answer.envelope.arrays_size() == 1);
  const pb::Array& frames = answer.envelope.arrays(0);
  CHECK(frames.name() == "frames");
  CHECK(frames.dtype() == pb::UINT8);
  return {frames.shape().begin(), frames.shape().end()};
}

TEST_CASE("Render answers with one picture a lane, in the order of the request") {
  WorkerFixture worker;
  worker.Open(3);
  worker.Reset({1, 1, 1});
  const Answer all = worker.Call(RenderRequest(), {});
  CHECK(ShapeOf(all) == std::vector<uint64_t>{3, kSide, kSide, 3});
  const Answer some = worker.Call(RenderRequest(), {Lanes({2, 0})});
  CHECK(ShapeOf(some) == std::vector<uint64_t>{2, kSide, kSide, 3});
  CHECK(FrameOf(some, 0) == FrameOf(all, 2));
  CHECK(FrameOf(some, 1) == FrameOf(all, 0));
  CHECK(FrameOf(all, 0) != FrameOf(all, 1));
}

TEST_CASE("A picture has the environment's own size unless another is asked for") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  CHECK(ShapeOf(worker.Call(RenderRequest(0, 0), {})) == std::vector<uint64_t>{1, 480, 480, 3});
  CHECK(ShapeOf(worker.Call(RenderRequest(64, 32), {})) == std::vector<uint64_t>{1, 32, 64, 3});
}

TEST_CASE("A lane can be stepped while its picture is being drawn") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.Step({2}, 1);  // the first step is measured, so that later ones are known to be short
  const std::string before = FrameOf(worker.Call(RenderRequest(), {}), 0);
  worker.answers.clear();
  worker.Send(RenderRequest(), {});
  worker.Send(WorkerFixture::StepRequest(), {Numbers({3}), Actions(1, 1)});
  // The step was executed at once: no BUSY, no waiting for the picture.
  REQUIRE(worker.answers.size() == 1);
  REQUIRE(worker.answers[0].code() == StatusCode::kOk);
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  // The picture is that of the moment when it was asked for.
  CHECK(FrameOf(worker.answers[1], 0) == before);
  CHECK(FrameOf(worker.Call(RenderRequest(), {}), 0) != before);
}

TEST_CASE("Render refuses what it cannot draw and names it") {
  WorkerFixture worker;
  worker.Open(64);
  CHECK(worker.Call(RenderRequest(), {}).code() ==
        StatusCode::kFailedPrecondition);  // no reset yet
  worker.Reset(std::vector<uint64_t>(64, 1));
  CHECK(worker.Call(RenderRequest(15, 64), {}).code() == StatusCode::kInvalidArgument);
  CHECK(worker.Call(RenderRequest(64, 1921), {}).code() == StatusCode::kInvalidArgument);
  CHECK(worker.Call(RenderRequest(), {Lanes({64})}).code() == StatusCode::kInvalidArgument);
  const Answer large = worker.Call(RenderRequest(1920, 1080), {});
  CHECK(large.code() == StatusCode::kInvalidArgument);
  CHECK(large.envelope.status().message().find("fewer lanes") != std::string::npos);
}

TEST_CASE("A session's requests for pictures wait in a queue of bounded length") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  for (uint32_t i = 0; i < limits::kMaxSessionRenders; ++i) worker.Send(RenderRequest(), {});
  CHECK(worker.answers.empty());
  worker.Send(RenderRequest(), {});
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  CHECK(worker.answers[0].envelope.status().recoverable());
  worker.Work();
  CHECK(worker.answers.size() == limits::kMaxSessionRenders + 1);
  CHECK(worker.Call(RenderRequest(), {}).code() == StatusCode::kOk);
}

TEST_CASE("Requests for pictures that wait in a worker are limited over all its sessions") {
  WorkerFixture worker;
  std::vector<std::string> tokens;
  for (uint32_t i = 0; i <= limits::kMaxRenderRequests / limits::kMaxSessionRenders; ++i) {
    tokens.push_back(OpenNumbered(worker, i, 1));
  }
  worker.answers.clear();
  const auto send = [&](const std::string& token) {
    pb::Request request = RenderRequest();
    request.set_session_token(token);
    worker.Send(request, {});
  };
  for (uint32_t i = 0; i < limits::kMaxRenderRequests; ++i) {
    send(tokens[i / limits::kMaxSessionRenders]);
  }
  CHECK(worker.answers.empty());
  send(tokens.back());
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
}

TEST_CASE("Pictures under way are bounded in bytes, but a single request is always taken") {
  WorkerFixture worker;
  const std::string other(limits::kTokenBytes, 'o');
  worker.memory.pictures = size_t{3} * kSide * kSide;
  worker.Restart();
  worker.Open(2);
  worker.Reset({1, 1});
  worker.Open(1, other);
  pb::Request of_other;
  of_other.set_session_token(other);
  of_other.mutable_reset();
  REQUIRE(worker.Call(of_other, {Numbers({1})}).code() == StatusCode::kOk);
  of_other = RenderRequest();
  of_other.set_session_token(other);

  worker.answers.clear();
  worker.Send(RenderRequest(), {});  // twice the share, of which nothing is held
  CHECK(worker.answers.empty());
  worker.Send(of_other, {});
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  CHECK(worker.answers[0].envelope.status().recoverable());
  CHECK_THAT(worker.answers[0].envelope.status().message(), Catch::Contains("at most 12288"));
  worker.Work();
  REQUIRE(worker.answers.size() == 2);
  CHECK(worker.answers[1].code() == StatusCode::kOk);
  // All is given back, by who was refused, too.
  CHECK(worker.Call(of_other, {}).code() == StatusCode::kOk);
  CHECK(worker.Call(RenderRequest(), {}).code() == StatusCode::kOk);
}

TEST_CASE("The states that wait to be painted count with the pictures") {
  constexpr uint32_t kSmall = 16;
  WorkerFixture worker;
  worker.memory.pictures = size_t{2} * 3 * kSmall * kSmall;  // of two pictures and no state
  worker.Restart();
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  worker.Send(RenderRequest(kSmall, kSmall), {});
  CHECK(worker.answers.empty());
  worker.Send(RenderRequest(kSmall, kSmall), {});
  REQUIRE(worker.answers.size() == 1);
  CHECK(worker.answers[0].code() == StatusCode::kLimitExceeded);
  worker.Work();
}

// The child processes of this one.
std::set<pid_t> Children() {
  std::set<pid_t> all;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream children(task.path() / "children");
    for (pid_t child = 0; children >> child;) all.insert(child);
  }
  return all;
}

TEST_CASE("Render is answered at its deadline though the painter stands still") {
  const std::set<pid_t> others = Children();
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  const std::string frame = FrameOf(worker.Call(RenderRequest(), {}), 0);
  std::set<pid_t> painter = Children();
  std::erase_if(painter, [&](const pid_t child) { return others.contains(child); });
  REQUIRE(painter.size() == 1);
  REQUIRE(kill(*painter.begin(), SIGSTOP) == 0);
  siginfo_t info{};
  REQUIRE(waitid(P_PID, static_cast<id_t>(*painter.begin()), &info, WSTOPPED | WNOWAIT) == 0);
  pb::Request late = RenderRequest();
  late.set_deadline_ms(50);
  const Clock::time_point start = Clock::now();
  CHECK(worker.Call(late, {}).code() == StatusCode::kDeadlineExceeded);
  CHECK(SecondsSince(start) < 1e-3 * static_cast<double>(limits::kLatePictureMs));
  REQUIRE(kill(*painter.begin(), SIGCONT) == 0);
  CHECK(FrameOf(worker.Call(RenderRequest(), {}), 0) == frame);
}

TEST_CASE("A request for a picture that came too late draws nothing") {
  WorkerFixture worker;
  worker.Open(1);
  worker.Reset({1});
  worker.answers.clear();
  for (uint32_t i = 1; i < limits::kMaxSessionRenders; ++i) worker.Send(RenderRequest(0, 0), {});
  pb::Request late = RenderRequest();
  late.set_deadline_ms(1);  // three pictures of 480 x 480 stand before it
  worker.Send(late, {});
  worker.Work();
  CHECK(worker.answers.back().code() == StatusCode::kDeadlineExceeded);
}

}  // namespace
}  // namespace b4mrl
