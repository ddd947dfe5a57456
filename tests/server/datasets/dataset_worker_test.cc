#include "server/datasets/dataset_worker.h"

#include <fmt/format.h>

#include <algorithm>
#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>

#include "data/columns/gather.h"
#include "data/columns/sampler.h"
#include "tests/server/datasets/dataset_worker_fixture.h"

namespace b4mrl {
namespace {

TEST_CASE("datasets are listed before and after their import") {
  DataFolder files;
  std::filesystem::create_directory(files.folder.File("d4rl"));
  REQUIRE(WriteExample(files.folder.File("d4rl/halfcheetah-medium-v2.hdf5"), files.data).ok());
  WriteBytes(files.folder.File("HalfCheetah/notes.txt"), "no dataset");
  Daemon daemon(files.folder.path());
  pb::Request list;
  list.mutable_list_datasets();
  const auto before = daemon.Ask(list);
  REQUIRE(before.reply.list_datasets().datasets_size() == 2);
  CHECK(before.reply.list_datasets().datasets(0).name() == "HalfCheetah/medium");
  CHECK(before.reply.list_datasets().datasets(0).rows() == 0);
  CHECK(before.reply.list_datasets().datasets(1).name() == "d4rl/halfcheetah-medium-v2");
  REQUIRE(daemon.Open("HalfCheetah/medium").code() == StatusCode::kOk);
  const auto after = daemon.Ask(list);
  CHECK(after.reply.list_datasets().datasets(0).rows() == 1500);
  CHECK(after.reply.list_datasets().datasets(0).sha256().size() == 64);
  CHECK(daemon.record().heartbeat > 0);
}

TEST_CASE("an import that takes long holds up nothing that is prepared") {
  DataFolder files;
  const std::string fingerprint =
      Daemon(files.folder.path()).Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  REQUIRE_FALSE(fingerprint.empty());
  REQUIRE(WriteExample(files.folder.File("HalfCheetah/other.h5"), files.data).ok());
  // Has mapped nothing yet, like a replacement.
  Daemon daemon(files.folder.path(), files.EndlessImporter());
  DealerSocket patient = daemon.Connect();
  pb::Request open;
  open.set_protocol_version(limits::kProtocolVersion);
  open.mutable_open_dataset()->set_dataset("HalfCheetah/other");
  REQUIRE(patient.Send({SerializeEnvelope(open).value(), Frame()}).ok());
  const Deadline soon = Deadline::AfterMs(kPatienceMs / 2);
  pb::Request list;
  list.mutable_list_datasets();
  CHECK(daemon.Ask(list).reply.list_datasets().datasets_size() == 2);
  CHECK(daemon.Sample(fingerprint, 0, 0, 5).code() == StatusCode::kOk);
  CHECK(daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint() == fingerprint);
  CHECK(daemon.Open("HalfCheetah/unknown").code() == StatusCode::kUnknownName);
  const auto derived = daemon.Open("HalfCheetah/medium", "hidden-high");
  INFO(derived.reply.status().message());
  CHECK(derived.code() == StatusCode::kOk);
  CHECK_FALSE(soon.expired());
  CHECK_FALSE(patient.TryReceive().has_value());
}

TEST_CASE("imports that never end keep neither another client's import nor deadlines waiting") {
  DataFolder files;
  constexpr int kEndless = 5;  // as many as may run at a time, of a client each
  for (int i = 0; i < kEndless; ++i) {
    WriteBytes(files.folder.File(fmt::format("HalfCheetah/endless-{}.h5", i)), "");
  }
  Daemon daemon(files.folder.path(), files.ImporterThatHangsOn("endless"));
  std::vector<DealerSocket> attackers;
  const auto ask_for = [&](int i, int64_t deadline_ms) {
    pb::Request open;
    open.set_protocol_version(limits::kProtocolVersion);
    open.set_deadline_ms(deadline_ms);
    open.mutable_open_dataset()->set_dataset(fmt::format("HalfCheetah/endless-{}", i));
    REQUIRE(attackers[i].Send({SerializeEnvelope(open).value(), Frame()}).ok());
  };
  for (int i = 0; i < kEndless; ++i) {
    attackers.push_back(daemon.Connect());
    ask_for(i, limits::kMaxDeadlineMs);
  }
  // It waits for the end of the others' first turn; 2.3 s in all on an idle machine.
  CHECK(daemon.Open("HalfCheetah/medium").code() == StatusCode::kOk);
  for (int i = 0; i < kEndless; ++i) {  // some have been started, some wait
    CAPTURE(i);
    const Clock::time_point asked = Clock::now();
    ask_for(i, 200);
    CHECK(daemon.Receive(attackers[i]).code() == StatusCode::kDeadlineExceeded);
    CHECK(SecondsSince(asked) >= 0.2);
    CHECK(SecondsSince(asked) < 20);  // 0.3 on an idle machine
  }
}

TEST_CASE("deadlines hold behind other derivations") {
  DataFolder files;
  REQUIRE(
      WriteExample(files.folder.File("HalfCheetah/large.h5"), MakeExampleDataset({60'000}, 17, 6))
          .ok());
  Daemon daemon(files.folder.path());
  REQUIRE(daemon.Open("HalfCheetah/large").code() == StatusCode::kOk);
  DealerSocket client = daemon.Connect();
  const auto ask = [&](uint64_t seed, int64_t deadline_ms) {
    pb::Request open;
    open.set_protocol_version(limits::kProtocolVersion);
    open.set_request_id(seed);
    open.set_deadline_ms(deadline_ms);
    open.mutable_open_dataset()->set_dataset("HalfCheetah/large");
    open.mutable_open_dataset()->set_seed(seed);
    pb::NamedArgument* noise = open.mutable_open_dataset()->add_corruptions();
    noise->set_name("obs-noise");
    noise->set_argument("0.1");
    REQUIRE(client.Send({SerializeEnvelope(open).value(), Frame()}).ok());
  };
  // Each draws two million numbers, two at a time.
  constexpr uint64_t kDerivations = 12;
  for (uint64_t seed = 1; seed <= kDerivations; ++seed) ask(seed, kPatienceMs);
  const Clock::time_point asked = Clock::now();
  ask(kDerivations + 1, 50);
  // The first of the others may be done before, never all of them.
  uint64_t done = 0;
  auto late = daemon.Receive(client);
  for (; late.reply.request_id() != kDerivations + 1; late = daemon.Receive(client)) ++done;
  CHECK(late.code() == StatusCode::kDeadlineExceeded);
  CHECK(done < kDerivations);
  CHECK(SecondsSince(asked) < 20);  // 0.15 on an idle machine
}

TEST_CASE("requests that wait for datasets are bounded, and what is mapped is served on") {
  DataFolder files;
  const std::string fingerprint =
      Daemon(files.folder.path()).Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  REQUIRE(WriteExample(files.folder.File("HalfCheetah/other.h5"), files.data).ok());
  Daemon daemon(files.folder.path(), files.EndlessImporter());
  REQUIRE(daemon.Sample(fingerprint, 0, 0, 5).code() == StatusCode::kOk);
  pb::Request open;
  open.set_protocol_version(limits::kProtocolVersion);
  open.set_deadline_ms(limits::kMaxDeadlineMs);
  open.mutable_open_dataset()->set_dataset("HalfCheetah/other");
  // Sends Opens on a connection of its own; the number of the first one that is refused.
  std::vector<DealerSocket> connections;
  const auto ask = [&](uint32_t times) {
    connections.push_back(daemon.Connect());
    for (uint32_t i = 1; i <= times; ++i) {
      open.set_request_id(i);
      REQUIRE(connections.back().Send({SerializeEnvelope(open).value(), Frame()}).ok());
    }
    const auto refused = daemon.Receive(connections.back());
    CHECK(refused.code() == StatusCode::kLimitExceeded);
    return refused.reply.request_id();
  };
  constexpr uint32_t kOfOneConnection = 64;
  for (uint32_t waiting = 0; waiting < limits::kMaxPendingDatasetRequests;
       waiting += kOfOneConnection) {
    CHECK(ask(kOfOneConnection + 1) == kOfOneConnection + 1);
  }
  CHECK(ask(1) == 1);
  CHECK(daemon.Sample(fingerprint, 0, 1, 5).code() == StatusCode::kOk);
}

TEST_CASE("a listing that is longer than an envelope comes in pages") {
  constexpr int kFiles = 1500;
  TemporaryFolder folder;
  std::filesystem::create_directory(folder.File("HalfCheetah"));
  for (int i = 0; i < kFiles; ++i) {
    WriteBytes(folder.File(fmt::format("HalfCheetah/{:05}-{}.h5", i, std::string(60, 'x'))), "");
  }
  Daemon daemon(folder.path());
  std::vector<std::string> names;
  int pages = 0;
  for (; names.size() < kFiles; ++pages) {
    pb::Request list;
    list.mutable_list_datasets()->set_first(static_cast<uint32_t>(names.size()));
    const auto page = daemon.Ask(list);
    REQUIRE(page.reply.list_datasets().total() == kFiles);
    REQUIRE(page.reply.list_datasets().datasets_size() > 0);
    for (const pb::DatasetInfo& info : page.reply.list_datasets().datasets()) {
      names.push_back(info.name());
    }
  }
  CHECK(pages > 1);
  CHECK(names.size() == kFiles);
  CHECK(std::ranges::is_sorted(names));
  CHECK(std::ranges::adjacent_find(names) == names.end());
  pb::Request beyond;
  beyond.mutable_list_datasets()->set_first(UINT32_MAX);
  CHECK(daemon.Ask(beyond).reply.list_datasets().datasets_size() == 0);
}

TEST_CASE("sampled rows are those of the file that the sampler names") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const auto opened = daemon.Open("HalfCheetah/medium");
  REQUIRE(opened.code() == StatusCode::kOk);
  CHECK(opened.reply.open_dataset().rows() == 1500);
  CHECK(opened.reply.open_dataset().observation_size() == 17);
  const std::string fingerprint = opened.reply.open_dataset().fingerprint();
  const auto batch = daemon.Sample(fingerprint, 11, 4, 256, 3);
  REQUIRE(batch.code() == StatusCode::kOk);
  const auto indices = batch.Values<uint64_t>("indices");
  REQUIRE(indices.size() == 768);
  for (uint64_t i = 0; i < 3; ++i) {
    std::vector<uint64_t> wanted(256);
    SampleRows(11, 4 + i, 1500, wanted);
    CHECK(std::equal(wanted.begin(), wanted.end(), indices.begin() + i * 256));
  }
  const auto observations = batch.Values<float>("observations");
  const auto next_observations = batch.Values<float>("next_observations");
  const auto actions = batch.Values<float>("actions");
  const auto rewards = batch.Values<float>("rewards");
  const auto terminals = batch.Values<uint8_t>("terminals");
  bool equal = true;
  for (size_t i = 0; i < indices.size(); ++i) {
    const size_t row = indices[i];
    equal &= std::memcmp(&observations[i * 17], &files.data.observations[row * 17], 68) == 0;
    equal &=
        std::memcmp(&next_observations[i * 17], &files.data.next_observations[row * 17], 68) == 0;
    equal &= std::memcmp(&actions[i * 6], &files.data.actions[row * 6], 24) == 0;
    equal &= rewards[i] == files.data.rewards[row];
    equal &= terminals[i] == files.data.terminals[row];
  }
  CHECK(equal);
  CHECK(daemon.Sample(fingerprint, 11, 6, 256).Values<float>("rewards") ==
        std::vector<float>(rewards.begin() + 512, rewards.end()));
}

TEST_CASE("an opened dataset says in which environment it was recorded") {
  DataFolder files;
  const auto write = [&](const std::string& path, const std::string& environment) {
    std::filesystem::create_directories(
        std::filesystem::path(files.folder.File(path)).parent_path());
    REQUIRE(WriteExample(files.folder.File(path), files.data, environment).ok());
  };
  write("HalfCheetah/walked.h5", "Walker2d");
  write("HalfCheetah/odd.h5", "a\x01\n" + std::string(1000, 'b'));
  write("d4rl/halfcheetah-medium-v2.hdf5", "");
  write("d4rl/halfcheetah.hdf5", "");
  write("Mine/first.h5", "");
  Daemon daemon(files.folder.path());
  const auto environment = [&](const std::string& name, const std::string& corruptions = "") {
    return daemon.Open(name, corruptions).reply.open_dataset().environment();
  };
  CHECK(environment("HalfCheetah/medium") == "HalfCheetah");
  CHECK(environment("HalfCheetah/walked") == "Walker2d");
  CHECK(environment("HalfCheetah/walked", "hidden=1") == "Walker2d");
  CHECK(environment("HalfCheetah/odd") == "a??" + std::string(1000, 'b'));
  CHECK(environment("d4rl/halfcheetah-medium-v2") == "HalfCheetah");
  CHECK(environment("d4rl/halfcheetah") == "HalfCheetah");
  CHECK(environment("Mine/first").empty());
}

TEST_CASE("reading walks through all rows in order and ends short") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const std::string fingerprint =
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  std::vector<float> observations;
  for (uint64_t first = 0; first < 1500; first += 400) {
    const auto part = daemon.Read(fingerprint, first, 400).Values<float>("observations");
    observations.insert(observations.end(), part.begin(), part.end());
  }
  CHECK(observations == files.data.observations);
  CHECK(daemon.Read(fingerprint, 1500, 10).Values<uint8_t>("timeouts").empty());
  CHECK(daemon.Read(fingerprint, 1501, 10).code() == StatusCode::kInvalidArgument);
}

TEST_CASE("statistics are those of the corrupted data") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const auto opened = daemon.Open("HalfCheetah/medium", "hidden-high");
  REQUIRE(opened.code() == StatusCode::kOk);
  CHECK(opened.reply.open_dataset().hidden_dimensions(0) == 9);
  CHECK(opened.reply.open_dataset().corruptions(0).argument() == "9");
  pb::Request stats;
  stats.mutable_dataset_stats()->set_fingerprint(opened.reply.open_dataset().fingerprint());
  const auto answer = daemon.Ask(stats);
  CHECK(answer.Values<double>("observation_std")[9] == 0);
  CHECK(answer.Values<double>("observation_std")[8] > 0.5);
  CHECK(answer.reply.dataset_stats().rows() == 1500);
  CHECK(answer.reply.dataset_stats().episodes() == 3);
}

TEST_CASE("the d4rl rule serves fewer rows under another fingerprint") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const auto stored = daemon.Open("HalfCheetah/medium", "obs-noise=0.1", 5);
  const auto d4rl = daemon.Open("HalfCheetah/medium", "obs-noise=0.1", 5, "d4rl");
  CHECK(d4rl.reply.open_dataset().rows() == 1498);  // two time-outs, the second the last row
  CHECK(d4rl.reply.open_dataset().fingerprint() != stored.reply.open_dataset().fingerprint());
  const auto all = daemon.Read(stored.reply.open_dataset().fingerprint(), 0, 1500);
  const auto kept = daemon.Read(d4rl.reply.open_dataset().fingerprint(), 0, 1500);
  const auto observations = all.Values<float>("observations");
  const auto next = kept.Values<float>("next_observations");
  CHECK(std::memcmp(&next[0], &observations[17], 68) == 0);
  // Row 700 of the file is row 699 of what is kept; it begins the second episode.
  CHECK(std::memcmp(&kept.Values<float>("observations")[699 * 17], &observations[700 * 17], 68) ==
        0);
}

TEST_CASE("a restarted worker serves fingerprints it has never opened") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const std::string fingerprint =
      daemon.Open("HalfCheetah/medium", "obs-noise-high", 2).reply.open_dataset().fingerprint();
  const auto before = daemon.Sample(fingerprint, 1, 2, 64).Values<float>("observations");
  daemon.Stop();
  CHECK(daemon.status.ok());
  daemon.Start();
  CHECK(daemon.Sample(fingerprint, 1, 2, 64).Values<float>("observations") == before);
}

TEST_CASE("a damaged cache is refused by fingerprint and made anew by name") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const std::string fingerprint =
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  const auto before = daemon.Sample(fingerprint, 1, 2, 64).Values<float>("observations");
  daemon.Stop();
  const std::string column = files.folder.File(".b4mrl-cache/" + fingerprint + "/observations.raw");
  std::string bytes = ReadBytes(column);
  bytes[1000] ^= 1;
  WriteBytes(column, bytes);
  daemon.Start();
  CHECK(daemon.Sample(fingerprint, 1, 2, 64).code() == StatusCode::kDataLoss);
  REQUIRE(daemon.Open("HalfCheetah/medium").code() == StatusCode::kOk);
  CHECK(daemon.Sample(fingerprint, 1, 2, 64).Values<float>("observations") == before);
  // A column's file that somebody has removed is damage, too.
  daemon.Stop();
  REQUIRE(std::filesystem::remove(column));
  daemon.Start();
  REQUIRE(daemon.Open("HalfCheetah/medium").code() == StatusCode::kOk);
  CHECK(daemon.Sample(fingerprint, 1, 2, 64).Values<float>("observations") == before);
}

TEST_CASE("a changed file gets another fingerprint") {
  DataFolder files;
  Daemon daemon(files.folder.path());
  const auto first = daemon.Open("HalfCheetah/medium");
  REQUIRE(WriteExample(files.folder.File("HalfCheetah/medium.h5"), MakeExampleDataset({10}, 17, 6))
              .ok());
  const auto second = daemon.Open("HalfCheetah/medium");
  CHECK(second.reply.open_dataset().rows() == 10);
  CHECK(second.reply.open_dataset().fingerprint() != first.reply.open_dataset().fingerprint());
  CHECK(second.reply.open_dataset().info().sha256() != first.reply.open_dataset().info().sha256());
}

TEST_CASE("bad requests are answered with typed errors") {
  DataFolder files;
  WriteBytes(files.folder.File("HalfCheetah/broken.h5"), "not HDF5");
  Daemon daemon(files.folder.path());
  const auto unknown = daemon.Open("HalfCheetah/medum");
  CHECK(unknown.code() == StatusCode::kUnknownName);
  CHECK_THAT(unknown.reply.status().message(), Catch::Contains("HalfCheetah/medium"));
  CHECK(daemon.Open("../HalfCheetah/medium").code() == StatusCode::kUnknownName);
  CHECK(daemon.Open("HalfCheetah/broken").code() == StatusCode::kDataLoss);
  CHECK(daemon.Open("HalfCheetah/medium", "gravity=2").code() == StatusCode::kUnsupported);
  CHECK(daemon.Open("HalfCheetah/medium", "", 0, "other").code() == StatusCode::kUnknownName);
  CHECK(daemon.Sample("no fingerprint", 0, 0, 1).code() == StatusCode::kUnknownName);
  CHECK(daemon.Sample(std::string(32, 'a'), 0, 0, 1).code() == StatusCode::kUnknownName);
  const std::string fingerprint =
      daemon.Open("HalfCheetah/medium").reply.open_dataset().fingerprint();
  CHECK(daemon.Sample(fingerprint, 0, 0, 0).code() == StatusCode::kInvalidArgument);
  CHECK(daemon.Sample(fingerprint, 0, 0, limits::kMaxRowsPerBatch + 1).code() ==
        StatusCode::kInvalidArgument);
  CHECK(daemon.Sample(fingerprint, 0, 0, 1, limits::kMaxBatchesPerSample + 1).code() ==
        StatusCode::kInvalidArgument);
  CHECK(daemon.Sample(fingerprint, 0, 0, limits::kMaxRowsPerBatch, 64).code() ==
        StatusCode::kInvalidArgument);
  pb::Request other;
  other.mutable_step();
  CHECK(daemon.Ask(other).code() == StatusCode::kUnsupported);
  other.set_protocol_version(99);
  CHECK(daemon.Ask(other).code() == StatusCode::kVersionMismatch);
  CHECK(daemon.record().errors >= 13);

  DealerSocket raw = daemon.Connect();
  REQUIRE(raw.Send({Frame::Copy("\xff\xff garbage"), Frame()}).ok());
  CHECK(daemon.Receive(raw).code() == StatusCode::kInvalidArgument);
}

TEST_CASE("a request that takes more memory than bytes may not wait") {
  const TemporaryFolder folder;
  pb::Request open;
  for (int i = 0; i < 2'000; ++i) open.mutable_open_dataset()->add_corruptions();
  const auto answer = Daemon(folder.path()).Ask(open);
  CHECK_THAT(answer.reply.status().message(), Catch::Contains("at most 32768"));
}

TEST_CASE("a missing data folder is named") {
  const TemporaryFolder folder;
  Daemon daemon(folder.File("none"));
  pb::Request list;
  list.mutable_list_datasets();
  const auto answer = daemon.Ask(list);
  CHECK(answer.code() == StatusCode::kIoError);
  CHECK_THAT(answer.reply.status().message(), Catch::Contains("none"));
}

}  // namespace
}  // namespace b4mrl
