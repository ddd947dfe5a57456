// The program that draws, from the worker's side: what it draws, and what its misfortunes cost.
#include "server/render/painter_process.h"

#include <sys/wait.h>

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <ctime>
#include <filesystem>
#include <set>
#include <vector>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "server/simulator/simulator.h"
#include "tests/data/temporary_folder.h"
#include "tests/environment_variable.h"
#include "tests/server/models/model_folders.h"

namespace b4mrl {
namespace {

constexpr uint32_t kSide = 96;

using Picture = std::vector<std::byte>;

// A request for a picture of a simulator at the start of episode `episode`.
PaintRequest RequestFor(const SimulatorRequest& which, uint64_t episode = 0) {
  PaintRequest request;
  request.simulator = which;
  const auto simulator = Simulator::Open(request.simulator);
  REQUIRE(simulator.ok());
  const auto scratch = (*simulator)->Borrow();
  REQUIRE(scratch.ok());
  Rng rng(episode, "painter_process_test");
  REQUIRE((*scratch)->Reset(rng).ok());
  request.identity = (*simulator)->identity_hash();
  request.width = request.height = kSide;
  request.state.resize((*scratch)->state_size());
  (*scratch)->SaveState(request.state);
  return request;
}

PaintRequest RequestFor(const std::string& environment, uint64_t episode = 0) {
  SimulatorRequest which;
  which.environment = environment;
  return RequestFor(which, episode);
}

Picture Blank(const PaintRequest& request) {
  return Picture(PictureBytes(request.width, request.height));
}

// For pictures that are drawn: a painter that starts on a busy machine takes its time.
Deadline Patience() { return Deadline::AfterMs(120'000); }

Picture Paint(PainterProcess& painter, const PaintRequest& request) {
  Picture picture = Blank(request);
  const Status status = painter.Paint(request, picture, Patience());
  INFO(status.ToString());
  REQUIRE(status.ok());
  return picture;
}

// One for all tests that do not hurt it: starting one takes much longer than drawing.
PainterProcess& SharedPainter() {
  static PainterProcess painter;
  return painter;
}

size_t ColoursOf(const Picture& picture) {
  std::set<std::vector<std::byte>> colours;
  for (size_t at = 0; at < picture.size(); at += 3) {
    colours.insert({picture.begin() + at, picture.begin() + at + 3});
  }
  return colours.size();
}

Status TryToPaint(PainterProcess& painter, const PaintRequest& request,
                  const Deadline& deadline = Patience()) {
  Picture picture = Blank(request);
  return painter.Paint(request, picture, deadline);
}

Status PaintWith(const std::string& program) {
  PainterProcess painter(program);
  return TryToPaint(painter, RequestFor("HalfCheetah"));
}

// Keeps the painter from drawing until it gets SIGCONT.
void Halt(const PainterProcess& painter) {
  REQUIRE(kill(painter.process_id(), SIGSTOP) == 0);
  siginfo_t info{};
  REQUIRE(waitid(P_PID, static_cast<id_t>(painter.process_id()), &info, WSTOPPED | WNOWAIT) == 0);
}

TEST_CASE("Equal states give equal pictures and other states others") {
  PainterProcess& painter = SharedPainter();
  const Picture first = Paint(painter, RequestFor("HalfCheetah"));
  CHECK(ColoursOf(first) > 50);  // light and shade, not a filled frame
  const Picture other = Paint(painter, RequestFor("HalfCheetah", 1));
  CHECK(other != first);
  CHECK(Paint(painter, RequestFor("HalfCheetah")) == first);
  PainterProcess another;
  CHECK(Paint(another, RequestFor("HalfCheetah")) == first);
}

TEST_CASE("A picture does not depend on what else its painter draws") {
  PainterProcess alone;
  PainterProcess busy;
  for (uint64_t episode = 0; episode < 4; ++episode) {
    Paint(busy, RequestFor("Hopper", episode));
    const PaintRequest request = RequestFor("HalfCheetah", episode);
    CHECK(Paint(busy, request) == Paint(alone, request));
  }
}

TEST_CASE("A scene of thousands of shapes is drawn whole, and more than once") {
  const Folders folders;
  SimulatorRequest walled;
  walled.environment = "Hopper";
  walled.perturbations = Take(ParseNamedArguments("model=model.xml"));
  const auto wall_of = [&](int boxes) {
    std::string wall;
    for (int i = 0; i < boxes; ++i) {
      wall += fmt::format(
          R"(<geom type="box" size=".02 .02 .02" pos="{} 1 {}" contype="0" conaffinity="0"/>)",
          0.04 * (i % 100 - 50), 0.04 * (i / 100));
    }
    const std::string text = Edited(OwnModel("hopper.xml"), "</worldbody>", wall + "</worldbody>");
    const std::string hash = Take(folders.CompileText(text));
    walled.compiled_model = {CompiledModelPath(folders.cache, hash), hash};
    return RequestFor(walled);
  };
  PainterProcess& painter = SharedPainter();
  const PaintRequest whole = wall_of(4500);
  const Picture first = Paint(painter, whole);
  CHECK(Paint(painter, whole) == first);
  CHECK(Paint(painter, wall_of(4000)) != first);  // lower: the last boxes were drawn
}

TEST_CASE("A painter draws many kinds of picture in turn") {
  PainterProcess& painter = SharedPainter();
  std::vector<Picture> pictures;
  // More sizes than it keeps OpenGL contexts for.
  for (int round = 0; round < 2; ++round) {
    for (const uint32_t side : {32u, 48u, 64u, 80u, 96u, 112u}) {
      PaintRequest request = RequestFor("HalfCheetah");
      request.width = side;
      request.height = side / 2;
      pictures.push_back(Paint(painter, request));
    }
  }
  for (size_t i = 0; i < pictures.size() / 2; ++i) {
    CHECK(pictures[i] == pictures[i + pictures.size() / 2]);
  }
}

double ProcessorSeconds(const PainterProcess& painter) {
  clockid_t clock{};
  REQUIRE(clock_getcpuclockid(painter.process_id(), &clock) == 0);
  timespec used{};
  REQUIRE(clock_gettime(clock, &used) == 0);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

TEST_CASE("A painter compiles shaders for its first kind of picture alone, and leaves no file") {
  const TemporaryFolder folder;
  const EnvironmentVariable temporary("TMPDIR", folder.path());
  PainterProcess painter;
  Paint(painter, RequestFor("HalfCheetah"));
  const double first = ProcessorSeconds(painter);
  Paint(painter, RequestFor("Hopper"));
  // It takes two fifths of the first one's time, and nine tenths if shaders are compiled again.
  CHECK(ProcessorSeconds(painter) - first < first * 2 / 3);
  CHECK(std::filesystem::is_empty(folder.path()));
}

TEST_CASE("What a painter refuses is the request's error and no more") {
  PainterProcess& painter = SharedPainter();
  const Picture good = Paint(painter, RequestFor("HalfCheetah"));
  const pid_t process = painter.process_id();
  PaintRequest bad = RequestFor("HalfCheetah");
  Picture picture = Blank(bad);
  SECTION("another model than the session's") {
    bad.identity += 1;
    CHECK(painter.Paint(bad, picture, Patience()).code() == StatusCode::kFailedPrecondition);
  }
  SECTION("an unknown environment") {
    bad.simulator.environment = "HalfCheeta";
    bad.identity += 1;  // or it would be drawn with what is open already
    CHECK(painter.Paint(bad, picture, Patience()).code() == StatusCode::kUnknownName);
  }
  SECTION("a state of another length") {
    bad.state.pop_back();
    CHECK(painter.Paint(bad, picture, Patience()).code() == StatusCode::kInvalidArgument);
  }
  CHECK(Paint(painter, RequestFor("HalfCheetah")) == good);
  CHECK(painter.process_id() == process);
}

TEST_CASE("A painter that has died is replaced") {
  PainterProcess painter;
  const Picture good = Paint(painter, RequestFor("HalfCheetah"));
  const pid_t process = painter.process_id();
  REQUIRE(kill(process, SIGKILL) == 0);
  siginfo_t info{};
  REQUIRE(waitid(P_PID, static_cast<id_t>(process), &info, WEXITED | WNOWAIT) == 0);
  CHECK(Paint(painter, RequestFor("HalfCheetah")) == good);
  CHECK(painter.process_id() != process);
}

TEST_CASE("A picture is waited for until its deadline, and its painter draws the next one") {
  PainterProcess painter;
  const Picture good = Paint(painter, RequestFor("HalfCheetah"));
  PaintRequest late = RequestFor("HalfCheetah");
  late.width *= 2;       // more bytes than those of the next picture
  Paint(painter, late);  // so that it takes little time when the painter goes on
  const pid_t process = painter.process_id();
  Halt(painter);
  CHECK(TryToPaint(painter, late, Deadline::AfterMs(20)).code() == StatusCode::kDeadlineExceeded);
  // The late picture is in the way of the next one until its own deadline, too.
  CHECK(TryToPaint(painter, RequestFor("HalfCheetah"), Deadline::AfterMs(20)).code() ==
        StatusCode::kDeadlineExceeded);
  SECTION("when it goes on") {
    REQUIRE(kill(process, SIGCONT) == 0);
    CHECK(Paint(painter, RequestFor("HalfCheetah")) == good);
    CHECK(painter.process_id() == process);
  }
  SECTION("when it has died") {
    REQUIRE(kill(process, SIGKILL) == 0);
    CHECK(Paint(painter, RequestFor("HalfCheetah")) == good);
    CHECK(painter.process_id() != process);
  }
}

TEST_CASE("A simulator whose pictures take too much processor time is not drawn for a while") {
  const TemporaryFolder folder;
  const std::string slow = folder.File("slow");
  WriteBytes(slow, "#!/bin/sh\nkill -PROF $$\n");
  std::filesystem::permissions(slow, std::filesystem::perms::owner_all);
  PainterProcess painter(slow);
  const PaintRequest request = RequestFor("HalfCheetah");
  for (uint32_t i = 0; i < limits::kMaxSlowPictures; ++i) {
    const Status status = TryToPaint(painter, request);
    CHECK(status.code() == StatusCode::kInternal);
    CHECK(status.message().find("processor time") != std::string::npos);
  }
  CHECK(TryToPaint(painter, request).code() == StatusCode::kLimitExceeded);
  CHECK(painter.process_id() == 0);
  CHECK(TryToPaint(painter, RequestFor("Hopper")).code() == StatusCode::kInternal);
}

TEST_CASE("A painter that ends, talks nonsense or is missing gives a typed error") {
  const Status ends = PaintWith("/bin/false");
  CHECK(ends.code() == StatusCode::kInternal);
  CHECK(ends.message().find("exit code 1") != std::string::npos);
  CHECK(PaintWith("/bin/true").code() ==
        StatusCode::kInternal);  // as an idle one would, again and again
  const TemporaryFolder folder;
  const std::string echo = folder.File("echo");
  WriteBytes(echo, "#!/bin/sh\nexec cat >&0\n");
  std::filesystem::permissions(echo, std::filesystem::perms::owner_all);
  const Status nonsense = PaintWith(echo);
  CHECK(nonsense.code() == StatusCode::kInternal);
  CHECK(nonsense.message().find("not an answer") != std::string::npos);
  CHECK(PaintWith("/nowhere/b4mrl-render").code() == StatusCode::kUnsupported);
}

}  // namespace
}  // namespace b4mrl
