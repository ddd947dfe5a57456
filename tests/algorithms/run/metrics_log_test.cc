// The logs of a run: lines, columns, and what TensorBoard reads. No daemon.
#include "algorithms/run/metrics_log.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <vector>

#include "algorithms/event.pb.h"
#include "tests/algorithms/test_daemon.h"

namespace b4mrl {
namespace {

constexpr const char* kEvents = "events.out.tfevents.b4mrl";

// CRC-32C bit by bit, as its definition reads: an implementation of the test's own.
uint32_t PlainCrc32c(std::string_view bytes) {
  uint32_t crc = 0xffffffff;
  for (const char c : bytes) {
    crc ^= static_cast<uint8_t>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc & 1 ? (crc >> 1) ^ 0x82f63b78 : crc >> 1;
  }
  return crc ^ 0xffffffff;
}

uint32_t PlainMask(uint32_t crc) { return ((crc >> 15) | (crc << 17)) + 0xa282ead8; }

template <typename T>
T Take(std::string_view& bytes) {
  REQUIRE(bytes.size() >= sizeof(T));
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  bytes.remove_prefix(sizeof value);
  return value;
}

// The messages of an event file, whose frames must be whole.
std::vector<events::Event> ReadEvents(const std::string& path) {
  const std::string file = ReadBytes(path);
  std::vector<events::Event> events;
  for (std::string_view rest = file; !rest.empty();) {
    const std::string_view length_bytes = rest.substr(0, 8);
    const auto length = Take<uint64_t>(rest);
    REQUIRE(Take<uint32_t>(rest) == PlainMask(PlainCrc32c(length_bytes)));
    REQUIRE(rest.size() >= length + 4);
    const std::string_view message = rest.substr(0, length);
    rest.remove_prefix(length);
    REQUIRE(Take<uint32_t>(rest) == PlainMask(PlainCrc32c(message)));
    REQUIRE(events.emplace_back().ParseFromArray(message.data(), static_cast<int>(length)));
  }
  return events;
}

}  // namespace

TEST_CASE("The checksum of event files is CRC-32C") {
  CHECK(Crc32c("123456789") == 0xe3069283);  // the algorithm's published check value
  CHECK(Crc32c("") == 0);
  const std::string bytes("\x00\xff\x80 and text", 12);
  CHECK(Crc32c(bytes) == PlainCrc32c(bytes));
  CHECK(MaskedCrc32c(bytes) == PlainMask(PlainCrc32c(bytes)));
}

TEST_CASE("A row becomes a line of JSON, of the table and an event") {
  TemporaryFolder folder;
  MetricsLog log = Take(MetricsLog::Open(folder.path(), {}));
  RequireOk(log.Write({{"update", 10},
                       {"critic_loss", 0.25},
                       {"episodic_return", std::nan("")},
                       {"evaluation_score", 0}}));
  CHECK(ReadBytes(folder.File("metrics.jsonl")) ==
        "{\"update\":10,\"critic_loss\":0.25,\"evaluation_score\":0}\n");
  CHECK(ReadBytes(folder.File("progress.csv")) ==
        "train/n_updates,train/critic_loss,eval/score\n10,0.25,0\n");
  const std::vector<events::Event> events = ReadEvents(folder.File(kEvents));
  REQUIRE(events.size() == 2);
  CHECK(events[0].file_version() == "brain.Event:2");
  CHECK(events[1].step() == 10);
  CHECK(events[1].wall_time() >= events[0].wall_time());
  REQUIRE(events[1].summary().value_size() == 2);
  CHECK(events[1].summary().value(0).tag() == "losses/critic_loss");
  CHECK(events[1].summary().value(0).simple_value() == 0.25f);
  CHECK(events[1].summary().value(1).tag() == "charts/evaluation_score");
  CHECK(events[1].summary().value(1).has_simple_value());  // zero is a value, too
}

TEST_CASE("Logs have the names that their readers know") {
  CHECK(TagOf("episodic_return") == "charts/episodic_return");
  CHECK(TagOf("evaluation_return") == "charts/evaluation_return");
  CHECK(TagOf("simulator_steps") == "ledger/simulator_steps");
  CHECK(TagOf("updates_per_second") == "charts/updates_per_second");
  CHECK(TagOf("actor_loss") == "losses/actor_loss");
  CHECK(ColumnOf("episodic_return") == "rollout/ep_rew_mean");
  CHECK(ColumnOf("environment_steps") == "time/total_timesteps");
  CHECK(ColumnOf("query_rows") == "ledger/query_rows");
  CHECK(ColumnOf("alpha") == "train/ent_coef");
  CHECK(ColumnOf("actor_loss") == "train/actor_loss");
}

TEST_CASE("A new value gets a column, and earlier lines an empty cell") {
  TemporaryFolder folder;
  MetricsLog log = Take(MetricsLog::Open(folder.path(), {}));
  RequireOk(log.Write({{"update", 1}, {"loss", 0.25}}));
  RequireOk(log.Write({{"update", 2}, {"episodic_return", 3}, {"loss", 0.125}}));
  RequireOk(log.Write({{"update", 3}, {"loss", 7}}));
  CHECK(ReadBytes(folder.File("progress.csv")) ==
        "train/n_updates,train/loss,rollout/ep_rew_mean\n1,0.25,\n2,0.125,3\n3,7,\n");
}

TEST_CASE("Resumed logs are cut back to their checkpoint and go on as if nothing had happened") {
  TemporaryFolder straight, resumed;
  const MetricRow rows[] = {{{"update", 1}, {"loss", 1.0 / 3}},
                            {{"update", 2}, {"loss", 0.125}, {"episodic_return", -1e-7}},
                            {{"update", 300}, {"loss", 0.5}, {"evaluation_return", 1e6}}};
  MetricsLog whole = Take(MetricsLog::Open(straight.path(), {}));
  for (const MetricRow& row : rows) RequireOk(whole.Write(row));

  MetricsLog::Offsets offsets;
  {
    MetricsLog first = Take(MetricsLog::Open(resumed.path(), {}));
    RequireOk(first.Write(rows[0]));
    offsets = first.offsets();
    RequireOk(first.Write(rows[1]));  // brings a column; lost, as after a kill
    RequireOk(first.Write(rows[2]));
  }
  MetricsLog second = Take(MetricsLog::Open(resumed.path(), offsets));
  RequireOk(second.Write(rows[1]));
  RequireOk(second.Write(rows[2]));
  for (const char* name : {"metrics.jsonl", "progress.csv"}) {
    CHECK(ReadBytes(resumed.File(name)) == ReadBytes(straight.File(name)));
  }
  // Of equal size, too: a TensorBoard that reads along goes on where it was.
  CHECK(second.offsets().event_bytes == whole.offsets().event_bytes);
  const auto events = ReadEvents(resumed.File(kEvents));
  REQUIRE(events.size() == 4);
  CHECK(events[3].step() == 300);
}

TEST_CASE("Logs that are shorter than their checkpoint says are refused") {
  TemporaryFolder folder;
  Take(MetricsLog::Open(folder.path(), {}));
  CHECK(MetricsLog::Open(folder.path(), {.json_bytes = 10}).status().code() ==
        StatusCode::kDataLoss);
}

}  // namespace b4mrl
