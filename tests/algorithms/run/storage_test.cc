// Replay files, checkpoints, means and hyperparameters; no daemon.
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <limits>
#include <string>

#include "algorithms/base/checkpoint.h"
#include "algorithms/base/learner.h"
#include "algorithms/base/metrics.h"
#include "algorithms/episodes/evaluate.h"
#include "algorithms/experience/replay_buffer.h"
#include "algorithms/list.h"
#include "algorithms/policy/observation_history.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

constexpr ReplayBuffer::Options kReplay = {.observation_size = 2, .action_size = 1, .capacity = 4};

void AppendNumbered(ReplayBuffer& replay, int from, int to) {
  for (int i = from; i < to; ++i) {
    const auto value = static_cast<float>(i);
    const float observation[] = {value, 10 * value}, action[] = {-value};
    const float next[] = {value + 1, 10 * value + 10};
    RequireOk(replay.Append({observation, action, next, value / 2, i % 2 == 1}));
  }
}

// The numbers of the records that many draws show.
std::vector<int> Drawn(const ReplayBuffer& replay) {
  BatchBuffer batch(2, 1, 200);
  Rng rng(1, "test");
  replay.Sample(rng, 0, 200, batch);
  std::vector<bool> seen(1000);
  for (int i = 0; i < 200; ++i) {
    const auto number = static_cast<int>(batch.observations.view()(0, i));
    seen[number] = true;
    // All parts of a row belong together.
    REQUIRE(batch.observations.view()(1, i) == static_cast<float>(10 * number));
    REQUIRE(batch.actions.view()(0, i) == static_cast<float>(-number));
    REQUIRE(batch.next_observations.view()(0, i) == static_cast<float>(number + 1));
    REQUIRE(batch.rewards[i] == static_cast<float>(number) / 2);
    REQUIRE(batch.not_terminated[i] == (number % 2 == 1 ? 0.0f : 1.0f));
  }
  std::vector<int> numbers;
  for (int i = 0; i < 1000; ++i) {
    if (seen[i]) numbers.push_back(i);
  }
  return numbers;
}

}  // namespace

TEST_CASE("A replay buffer draws from its newest records, whole rows, in memory and in a file") {
  TemporaryFolder folder;
  ReplayBuffer memory = Take(ReplayBuffer::InMemory(kReplay));
  ReplayBuffer file = Take(ReplayBuffer::CreateFile(folder.File("replay.bin"), kReplay));
  for (ReplayBuffer* replay : {&memory, &file}) {
    AppendNumbered(*replay, 0, 3);
    CHECK(Drawn(*replay) == std::vector<int>{0, 1, 2});
    AppendNumbered(*replay, 3, 7);
    CHECK(replay->size() == 4);
    CHECK(replay->length() == 7);
    CHECK(Drawn(*replay) == std::vector<int>{3, 4, 5, 6});
    replay->DropBefore(5);
    CHECK(Drawn(*replay) == std::vector<int>{5, 6});
  }
}

TEST_CASE("A replay file continues at a checkpoint's length and drops what came after") {
  TemporaryFolder folder;
  const std::string path = folder.File("replay.bin");
  {
    ReplayBuffer replay = Take(ReplayBuffer::CreateFile(path, kReplay));
    AppendNumbered(replay, 0, 9);
    RequireOk(replay.Sync());
  }
  ReplayBuffer resumed = Take(ReplayBuffer::ResumeFile(path, kReplay, 6));
  CHECK(Drawn(resumed) == std::vector<int>{2, 3, 4, 5});
  AppendNumbered(resumed, 6, 7);
  CHECK(Drawn(resumed) == std::vector<int>{3, 4, 5, 6});
}

TEST_CASE("A replay file that is foreign or too short is refused") {
  TemporaryFolder folder;
  const std::string path = folder.File("replay.bin");
  WriteBytes(path, "no replay at all");
  CHECK(ReplayBuffer::ResumeFile(path, kReplay, 1).status().code() == StatusCode::kDataLoss);
  { Take(ReplayBuffer::CreateFile(path, kReplay)); }
  ReplayBuffer::Options other = kReplay;
  other.action_size = 2;
  CHECK(ReplayBuffer::ResumeFile(path, other, 0).status().code() == StatusCode::kDataLoss);
  CHECK(ReplayBuffer::ResumeFile(path, kReplay, 10'000'000).status().code() ==
        StatusCode::kDataLoss);
  CHECK(ReplayBuffer::ResumeFile(folder.File("none"), kReplay, 0).status().code() ==
        StatusCode::kIoError);
}

TEST_CASE("A checkpoint gives back what was put in, and names what does not fit") {
  TemporaryFolder folder;
  const std::string path = CheckpointPath(folder.path(), 7);
  CheckpointWriter writer = Take(CheckpointWriter::Create(path));
  const std::vector<float> floats = {1.5f, -2.0f, std::numeric_limits<float>::denorm_min()};
  const std::vector<uint8_t> bytes = {0, 1, 128, 255};
  writer.Floats("a/floats", floats);
  writer.Floats("a/empty", {});
  writer.Bytes("a/bytes", bytes);
  writer.Unsigned("a/unsigned", UINT64_MAX);
  writer.Integer("a/integer", 5);
  writer.Number("a/number", 0.1);
  RequireOk(writer.Commit());

  CheckpointReader reader = Take(CheckpointReader::Open(path));
  CHECK(reader.Floats("a/floats") == floats);
  CHECK(reader.Floats("a/empty").empty());
  CHECK(reader.Bytes("a/bytes") == bytes);
  CHECK(reader.Unsigned("a/unsigned") == UINT64_MAX);
  CHECK(reader.Integer("a/integer") == 5);
  CHECK(reader.Number("a/number") == 0.1);
  RequireOk(reader.status());
  std::vector<float> two(2);
  reader.FloatsInto("a/floats", two);
  CHECK(reader.status().code() == StatusCode::kDataLoss);
}

TEST_CASE("Numbers of a checkpoint that are no integers, counters or bytes are damage") {
  TemporaryFolder folder;
  const std::string path = CheckpointPath(folder.path(), 7);
  CheckpointWriter writer = Take(CheckpointWriter::Create(path));
  const std::vector<std::string> wrong = {"negative", "half", "nan", "huge"};
  const double values[] = {-1, 0.5, std::nan(""), 1e300};
  for (size_t i = 0; i < wrong.size(); ++i) writer.Number("core/" + wrong[i], values[i]);
  writer.Floats("core/bytes", std::vector<float>{1, 256});
  writer.Number("core/most", 9007199254740992.0);
  RequireOk(writer.Commit());
  for (const std::string& name : wrong) {
    INFO(name);
    CheckpointReader integer = Take(CheckpointReader::Open(path));
    CHECK(integer.Integer("core/" + name) == 0);
    CHECK(integer.status().code() == StatusCode::kDataLoss);
    CHECK(integer.status().message().find("core/" + name) != std::string::npos);
    CheckpointReader counter = Take(CheckpointReader::Open(path));
    int64_t steps = 3;
    counter.Counters("core")({name, &steps});
    CHECK(steps == 3);
    CHECK(counter.status().code() == StatusCode::kDataLoss);
  }
  CheckpointReader reader = Take(CheckpointReader::Open(path));
  CHECK(reader.Integer("core/most") == int64_t{1} << 53);
  RequireOk(reader.status());
  CHECK(reader.Bytes("core/bytes").empty());
  CHECK(reader.status().code() == StatusCode::kDataLoss);
}

TEST_CASE("Of a run's checkpoints the newest two are kept") {
  TemporaryFolder folder;
  for (const uint64_t update : {5, 100, 20}) WriteBytes(CheckpointPath(folder.path(), update), "");
  RemoveOldCheckpoints(folder.path());
  CHECK(Take(ListCheckpoints(folder.path())) == std::vector<uint64_t>{100, 20});
}

TEST_CASE("A run's folder that cannot be read does not pass for an empty one") {
  TemporaryFolder folder;
  CHECK(Take(ListCheckpoints(folder.File("missing"))).empty());
  WriteBytes(folder.File("file"), "");
  CHECK(ListCheckpoints(folder.File("file")).status().code() == StatusCode::kIoError);
}

TEST_CASE("A checkpoint names a core's array that is not finite") {
  TemporaryFolder folder;
  CheckpointWriter writer = Take(CheckpointWriter::Create(CheckpointPath(folder.path(), 1)));
  std::vector<float> good = {1, 2}, bad = {1, std::numeric_limits<float>::infinity()};
  const ArrayVisitor<float> arrays = writer.Arrays("core");
  arrays({"actor/weight", {2}, good});
  CHECK_FALSE(writer.first_nonfinite());
  arrays({"critic/weight", {2}, bad});
  CHECK(writer.first_nonfinite() == "core/critic.weight");
}

TEST_CASE("Means are taken since the last line, and the first bad number is remembered") {
  MetricMeans means;
  means.Add("loss", 1);
  means.Add("loss", 3);
  CHECK(means.Row()[0].value == 2);
  means.Restart();
  CHECK(std::isnan(means.Row()[0].value));
  CHECK_FALSE(means.first_nonfinite());
  means.Add("loss", std::numeric_limits<double>::infinity());
  means.Add("other", std::nan(""));
  REQUIRE(means.first_nonfinite());
  CHECK(means.first_nonfinite()->name == "loss");
}

TEST_CASE("A history repeats an episode's first observation and drops the oldest") {
  ObservationHistory history(3, 2, 1);
  const float a[] = {1, 2}, b[] = {3, 4};
  history.Reset(0, a);
  history.Push(0, b);
  const std::span<const float> stacked = history.lane(0);
  CHECK(std::vector<float>(stacked.begin(), stacked.end()) == std::vector<float>{1, 2, 1, 2, 3, 4});
}

TEST_CASE("Hyperparameters refuse unknown names and values outside their range") {
  const Algorithm* sac = Take(FindAlgorithm("sac"));
  Hyperparameters values(sac->hyperparameters);
  RequireOk(values.Set("gamma", 0.5));
  CHECK(values.Number("gamma") == 0.5);
  CHECK(values.Set("gamma", 1.5).code() == StatusCode::kInvalidArgument);
  CHECK(values.Set("gamma", std::nan("")).code() == StatusCode::kInvalidArgument);
  CHECK(values.Set("batch-size", 2.5).code() == StatusCode::kInvalidArgument);
  const Status unknown = values.Set("gama", 0.5);
  CHECK(unknown.code() == StatusCode::kUnknownName);
  CHECK(unknown.message().find("'gamma'") != std::string::npos);
}

TEST_CASE("Choices are set by name, never by number, and are shown by name") {
  const HyperparameterTable table = {
      Choice("actor", "deterministic|gaussian", 0, "policy", ""),
      Switch("normalise", true, "observations", ""),
      Real("gamma", 0.99, {0, 1}, "discount"),
  };
  Hyperparameters values(table);
  CHECK(values.Find("actor")->Text() == "deterministic");
  CHECK(values.Chosen("actor", "deterministic"));
  CHECK(values.Chosen("normalise", "true"));
  RequireOk(values.SetText("actor", "gaussian"));
  CHECK(values.Integer("actor") == 1);
  CHECK(values.Chosen("actor", "gaussian"));
  CHECK_FALSE(values.Chosen("actor", "deterministic"));
  CHECK(values.Find("actor")->Text() == "gaussian");
  for (const char* wrong : {"0", "1", "gausian", ""}) {
    INFO("'" << wrong << "'");
    CHECK(values.SetText("actor", wrong).code() == StatusCode::kUnknownName);
  }
  CHECK(values.SetText("actor", "gausian").message().find("did you mean 'gaussian'") !=
        std::string::npos);
  CHECK(values.Integer("actor") == 1);
  CHECK(values.Find("normalise")->Text() == "true");
  for (const char* off : {"false", "0"}) {  // as records of earlier versions have it
    RequireOk(values.Set("normalise", 1));
    RequireOk(values.SetText("normalise", off));
    CHECK(values.Number("normalise") == 0);
  }
  CHECK(values.SetText("normalise", "2").code() == StatusCode::kUnknownName);
  RequireOk(values.SetText("gamma", "0.5"));
  CHECK(values.Find("gamma")->Text() == "0.5");
  for (const char* wrong : {"half", "2", "nan", "0.5x", "true"}) {
    INFO("'" << wrong << "'");
    CHECK(values.SetText("gamma", wrong).code() == StatusCode::kInvalidArgument);
  }
}

TEST_CASE("A hyperparameter that a table lacks ends the program by name") {
  std::array<int, 2> err{};
  REQUIRE(pipe(err.data()) == 0);
  const pid_t child = fork();
  REQUIRE(child >= 0);
  if (child == 0) {
    dup2(err[1], STDERR_FILENO);
    std::signal(SIGABRT, SIG_DFL);  // not the test framework's
    const Hyperparameters values(Take(FindAlgorithm("sac"))->hyperparameters);
    values.Integer("no-such-name");
    _exit(0);
  }
  close(err[1]);
  std::string text(1000, '\0');
  const ssize_t length = read(err[0], text.data(), text.size());
  close(err[0]);
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK((WIFSIGNALED(status) && WTERMSIG(status) == SIGABRT));
  text.resize(static_cast<size_t>(std::max<ssize_t>(length, 0)));
  CHECK(text.find("'no-such-name'") != std::string::npos);
}

TEST_CASE("A checkpoint keeps all of an evaluation") {
  const TemporaryFolder folder;
  EvaluationResult result = {.returns = {1, 3},
                             .lengths = {5, 7},
                             .given_up = 1,
                             .mean_return = 2,
                             .std_return = 1,
                             .score = 40};
  CheckpointWriter writer = Take(CheckpointWriter::Create(folder.File("checkpoint.h5")));
  SaveEvaluation(writer, "with", result);
  result.score.reset();
  SaveEvaluation(writer, "without", result);
  RequireOk(writer.Commit());
  CheckpointReader reader = Take(CheckpointReader::Open(folder.File("checkpoint.h5")));
  const EvaluationResult kept = LoadEvaluation(reader, "with");
  CHECK(kept.returns == result.returns);
  CHECK(kept.lengths == result.lengths);
  CHECK(kept.given_up == 1);
  CHECK(kept.mean_return == 2);
  CHECK(kept.std_return == 1);
  CHECK(kept.score == 40);
  CHECK_FALSE(LoadEvaluation(reader, "without").score.has_value());
  RequireOk(reader.status());
}

TEST_CASE("Every algorithm's choices are the whole numbers of their range") {
  for (const Algorithm& algorithm : Algorithms()) {
    for (const Hyperparameter& entry : algorithm.hyperparameters) {
      if (entry.choices.empty()) continue;
      INFO(algorithm.name << " " << entry.name);
      CHECK(entry.whole);
      CHECK(entry.low == 0);
      CHECK(entry.high == static_cast<double>(entry.ChoiceNames().size() - 1));
    }
  }
}

TEST_CASE("Every algorithm's defaults lie in their own ranges") {
  for (const Algorithm& algorithm : Algorithms()) {
    Hyperparameters values(algorithm.hyperparameters);
    for (const Hyperparameter& entry : algorithm.hyperparameters) {
      INFO(algorithm.name << " " << entry.name);
      CHECK(values.Set(entry.name, entry.value).ok());
    }
  }
  const Status unknown = FindAlgorithm("td3bc").status();
  CHECK(unknown.message().find("'td3-bc'") != std::string::npos);
}

}  // namespace b4mrl
