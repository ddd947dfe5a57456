// When a connection sends a request again.
#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/connection.h"
#include "tests/client/connection_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("after a reconnection every unanswered request is sent again, unchanged but for time") {
  ConnectionFixture fixture;
  const uint64_t answered = fixture.Send("answered");
  const uint64_t lost = fixture.Send("lost", kPatientMs, Frame::Copy(std::string(1000, 'p')));
  const uint64_t also_lost = fixture.Send("also lost");
  fixture.server().Echo(fixture.Take());
  CHECK(fixture.ReceiveText(answered) == "answered");
  const std::array before = {fixture.Take(), fixture.Take()};
  fixture.KillServer();

  std::vector<FakeCall> after;
  std::thread replacement([&fixture, &after] {
    FakeServer server(fixture.folder().Address());
    for (int i = 0; i < 2; ++i) {
      std::optional<FakeCall> call = server.Take();
      if (!call) return;
      after.push_back(std::move(*call));
    }
    for (const FakeCall& call : after) server.Echo(call);
    // Lets the replies leave before the socket closes; nothing else is to come.
    if (std::optional<FakeCall> surplus = server.Take(200)) after.push_back(std::move(*surplus));
  });
  const std::string first_text = fixture.ReceiveText(lost);
  const std::string second_text = fixture.ReceiveText(also_lost);
  replacement.join();
  CHECK(first_text == "lost");
  CHECK(second_text == "also lost");
  REQUIRE(after.size() == 2);
  for (size_t i = 0; i < 2; ++i) {
    CHECK(WithoutDeadline(after[i]) == WithoutDeadline(before[i]));
    CHECK(after[i].request.deadline_ms() <= before[i].request.deadline_ms());
  }
  CHECK(fixture.connection().connections() >= 2);
}

// The outcome of a request that a server answers only after its deadline, over a new connection.
Status AnswerOverdue(int64_t deadline_ms) {
  ConnectionFixture fixture;
  const uint64_t lost = fixture.Send("lost", deadline_ms);
  const Deadline deadline = Deadline::AfterMs(deadline_ms);
  const FakeCall before = fixture.Take();
  fixture.KillServer();
  FakeServer replacement(fixture.folder().Address());
  while (fixture.connection().connections() < 2 || !deadline.expired()) {
    REQUIRE_FALSE(replacement.Take(20).has_value());  // the caller is busy elsewhere
  }
  std::thread answer([&replacement, &before] {
    const std::optional<FakeCall> call = replacement.Take();
    if (call && WithoutDeadline(*call) == WithoutDeadline(before)) replacement.Echo(*call);
  });
  const Result<ReceivedReply> reply = fixture.connection().Receive(lost);
  answer.join();
  return reply.status();
}

TEST_CASE("a deadline that passed while nobody waited does not end what a reconnection lost") {
  // An eighth of the deadline is left for an echo. On a machine that stalls for longer, a longer
  // deadline has to show it.
  Status status = AnswerOverdue(1'600);
  for (const int64_t deadline_ms : {6'400, 25'600}) {
    if (!status.ok()) status = AnswerOverdue(deadline_ms);
  }
  CHECK(status.ToString() == "OK");
}

TEST_CASE("a request is sent again after an eighth of its deadline in silence") {
  ConnectionFixture fixture;
  constexpr int64_t kDeadlineMs = 4'000;
  double silence = 0;
  std::string first_copy;
  std::string second_copy;
  const uint64_t id = fixture.Send("quiet", kDeadlineMs);
  const FakeCall call = fixture.Take();
  const Clock::time_point taken = Clock::now();
  std::thread server([&] {
    const std::optional<FakeCall> again = fixture.server().Take();
    silence = SecondsSince(taken);
    if (!again) return;
    second_copy = WithoutDeadline(*again);
    fixture.server().Echo(*again);
  });
  const std::string text = fixture.ReceiveText(id);
  server.join();
  CHECK(text == "quiet");
  CHECK(second_copy == WithoutDeadline(call));
  // It was taken a little after it was sent.
  CHECK(silence > 0.8 * kDeadlineMs / 8 / 1000);
}

TEST_CASE("each further silence before a request is sent again is twice as long") {
  ConnectionFixture fixture;
  constexpr uint32_t kDeadlineMs = 4'000;
  const uint64_t id = fixture.Send("quiet", kDeadlineMs);
  // The time that is left, as each copy says, tells when it was sent.
  std::vector<uint32_t> left;
  std::thread server([&fixture, &left] {
    std::optional<FakeCall> call;
    while (left.size() < 3 && (call = fixture.server().Take())) {
      left.push_back(call->request.deadline_ms());
    }
    if (call) fixture.server().Echo(*call);
  });
  CHECK(fixture.ReceiveText(id) == "quiet");
  server.join();
  REQUIRE(left.size() == 3);
  // Each number is rounded to a millisecond.
  CHECK(left[0] - left[1] + 1 >= kDeadlineMs / 8);
  CHECK(left[1] - left[2] + 1 >= kDeadlineMs / 4);
}

TEST_CASE(
    "a request is not sent again while earlier ones are answered, or one of them many times") {
  const int requests = GENERATE(6, 1);
  ConnectionFixture fixture;
  constexpr int64_t kSlowDeadlineMs = 8'000;
  constexpr double kPatienceSeconds = kSlowDeadlineMs / 8 / 1000.0;
  constexpr int kAnswers = 6;
  std::vector<uint64_t> earlier;
  for (int i = 0; i < requests; ++i) earlier.push_back(fixture.Send("earlier"));
  const uint64_t slow = fixture.Send("slow", kSlowDeadlineMs);
  std::vector<FakeCall> calls;
  for (int i = 0; i <= requests; ++i) calls.push_back(fixture.Take());
  double longest_gap = 0;
  int copies = 1;
  Clock::time_point answered = Clock::now();
  for (int i = 0; i < kAnswers; ++i) {
    // Later requests pass the time.
    while (SecondsSince(answered) < 0.3 * kPatienceSeconds) {
      const uint64_t quick = fixture.Send("quick");
      FakeCall call = fixture.Take();
      while (call.request.request_id() != quick) {
        ++copies;
        call = fixture.Take();
      }
      fixture.server().Echo(call);
      CHECK(fixture.ReceiveText(quick) == "quick");
    }
    fixture.server().Echo(calls[i % requests]);
    if (i < requests) CHECK(fixture.ReceiveText(earlier[i]) == "earlier");
    longest_gap = std::max(longest_gap, SecondsSince(answered));
    answered = Clock::now();
  }
  fixture.server().Echo(calls[requests]);
  CHECK(fixture.ReceiveText(slow) == "slow");
  // On a machine that stalls the test for that long, the silence was real.
  if (longest_gap < kPatienceSeconds) CHECK(copies == 1);
}

TEST_CASE("a lost request is sent again though later ones are answered all the time") {
  ConnectionFixture fixture;
  const uint64_t lost = fixture.Send("lost", 8'000);
  const FakeCall first = fixture.Take();
  const Clock::time_point start = Clock::now();
  bool is_answered = false;
  while (!is_answered && SecondsSince(start) < 6) {
    const uint64_t quick = fixture.Send("quick");
    FakeCall call = fixture.Take();
    while (call.request.request_id() != quick) {
      CHECK(WithoutDeadline(call) == WithoutDeadline(first));
      fixture.server().Echo(call);
      is_answered = true;
      call = fixture.Take();
    }
    fixture.server().Echo(call);
    CHECK(fixture.ReceiveText(quick) == "quick");
  }
  REQUIRE(is_answered);
  CHECK(fixture.ReceiveText(lost) == "lost");
}

}  // namespace
}  // namespace b4mrl
