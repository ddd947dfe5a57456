// proto/PROTOCOL.md shows a Step and a Sample byte by byte. Here the client and the server make the
// same messages, and every byte must be there.
#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <filesystem>
#include <fstream>
#include <functional>
#include <mutex>
#include <sstream>
#include <string>

#include "data/d4rl/dataset_file_writer.h"
#include "tests/client/fake_daemon.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

constexpr char kToken[] = "0123456789abcdef";
constexpr size_t kCheetahObservationSize = 17;
constexpr size_t kCheetahActionSize = 6;
constexpr uint64_t kRequestId = 2;
constexpr uint32_t kDeadlineMs = 10'000;

// The bytes of the document's block "```bytes NAME". A line is hex bytes, "XX*N" for N equal ones
// and "NNNN:" for the offset so far, up to a "|" that starts its comment.
std::string DocumentedBytes(const std::string& name) {
  std::ifstream file(B4MRL_SOURCE_DIR "/proto/PROTOCOL.md");
  std::string line;
  while (std::getline(file, line) && line != "```bytes " + name) {
  }
  INFO("block " << name);
  REQUIRE(file.good());
  std::string bytes;
  while (std::getline(file, line) && line != "```") {
    std::istringstream words(line.substr(0, line.find('|')));
    for (std::string word; words >> word;) {
      const size_t times = word.find('*');
      if (word.ends_with(':')) {
        CHECK(std::stoul(word, nullptr, 16) == bytes.size());
      } else {
        bytes.append(times == std::string::npos ? 1 : std::stoul(word.substr(times + 1)),
                     static_cast<char>(std::stoul(word.substr(0, times), nullptr, 16)));
      }
    }
  }
  return bytes;
}

std::string Hex(std::string_view bytes) {
  std::string text;
  for (size_t i = 0; i < bytes.size(); ++i) {
    text += fmt::format("{}{:02x}", i % 16 == 0 ? fmt::format("\n{:04x}: ", i) : " ",
                        static_cast<unsigned char>(bytes[i]));
  }
  return text;
}

void CheckBlock(const std::string& name, std::string_view bytes) {
  INFO("block " << name << " should hold:" << Hex(bytes));
  CHECK(DocumentedBytes(name) == bytes);
}

// What differs from call to call is set to what the document says.
std::string Normalised(pb::Request request) {
  request.set_request_id(kRequestId);
  request.set_deadline_ms(kDeadlineMs);
  if (!request.session_token().empty()) request.set_session_token(kToken);
  if (request.has_sample()) request.mutable_sample()->set_fingerprint(std::string(32, 'f'));
  return request.SerializeAsString();
}
std::string Normalised(pb::Reply reply) {
  reply.set_request_id(kRequestId);
  pb::Timing* timing = reply.mutable_timing();
  timing->set_queued_us(3);
  timing->set_simulating_us(reply.has_step() ? 60 : 0);
  timing->set_serialising_us(2);
  return reply.SerializeAsString();
}

// Four rows whose arrays are zero but for their first dimensions; the last one is terminal.
void WriteDataset(const std::string& path) {
  std::vector<float> observations(4 * kCheetahObservationSize);
  std::vector<float> next_observations(observations.size());
  std::vector<float> actions(4 * kCheetahActionSize);
  std::vector<float> rewards(4);
  for (size_t row = 0; row < 4; ++row) {
    observations[row * kCheetahObservationSize] = static_cast<float>(row + 1);
    next_observations[row * kCheetahObservationSize] = static_cast<float>(row + 2);
    actions[row * kCheetahActionSize] = -0.5f;
    rewards[row] = 0.25f * static_cast<float>(row);
  }
  const std::vector<uint8_t> terminals = {0, 0, 0, 1};
  const std::vector<uint8_t> timeouts(4);
  Result<DatasetWriter> writer = DatasetWriter::Create(
      path,
      {.observation_dimensions = kCheetahObservationSize, .action_dimensions = kCheetahActionSize});
  REQUIRE(writer.ok());
  REQUIRE(writer
              ->Append({{.rows = 4,
                         .observations = observations,
                         .actions = actions,
                         .rewards = rewards,
                         .next_observations = next_observations,
                         .terminals = terminals,
                         .timeouts = timeouts}})
              .ok());
  REQUIRE(writer->Commit().ok());
}

class Daemon {
 public:
  Daemon() {
    std::filesystem::create_directories(folder_.File("HalfCheetah"));
    WriteDataset(folder_.File("HalfCheetah/tiny.h5"));
    daemon_.emplace(StartDaemon({.data_folder = folder_.path()}));
    client_.emplace(Connect(daemon_->endpoint()));
  }
  Client& client() { return *client_; }

 private:
  TemporaryFolder folder_;
  std::optional<PrivateDaemon> daemon_;
  std::optional<Client> client_;
};

// Keeps the requests that `use` makes, whatever becomes of them, and returns the first `kind`.
FakeCall Capture(pb::Request::PayloadCase kind, const std::function<void(Client&)>& use) {
  std::mutex mutex;
  std::optional<FakeCall> captured;
  FakeDaemon fake([&](FakeServer& server, FakeCall& call) {
    const std::lock_guard lock(mutex);
    if (call.request.has_reset()) {  // the fake's own reply has other observations
      pb::Reply reply;
      ArrayLayout layout(reply.mutable_arrays());
      layout.Add("observations", DType::kFloat32, {1, kCheetahObservationSize});
      server.Reply(call, std::move(reply), layout.Allocate());
      return true;
    }
    if (call.request.payload_case() != kind || captured) return false;
    captured = FakeCall{call.sender, call.request, call.payload.Share()};
    return false;
  });
  // Together with the fake's own dimensions, HalfCheetah's.
  for (size_t i = kObservationSize; i < kCheetahObservationSize; ++i) {
    fake.open_reply.mutable_info()->mutable_observation()->add_dimensions();
  }
  for (size_t i = kActionSize; i < kCheetahActionSize; ++i) {
    fake.open_reply.mutable_info()->mutable_action()->add_dimensions();
  }
  {
    Result<Client> client = Client::Connect(fake.address());
    REQUIRE(client.ok());
    use(*client);
  }
  const std::lock_guard lock(mutex);
  REQUIRE(captured.has_value());
  return std::move(*captured);
}

const std::vector<float> kAction = {0.5f, -0.5f, 0.25f, -0.25f, 1, -1};

TEST_CASE("the document's Step request is what the client sends") {
  const FakeCall call = Capture(pb::Request::kStep, [](Client& client) {
    Result<RemoteEnvironment> environment = client.Make("HalfCheetah");
    REQUIRE(environment.ok());
    (void)environment->Reset();
    (void)environment->Step(kAction);
  });
  CheckBlock("step-request", Normalised(call.request));
  CheckBlock("step-request-arrays", call.payload.view());
}

TEST_CASE("the document's Sample request is what the client sends") {
  const FakeCall call = Capture(pb::Request::kSample, [](Client& client) {
    Result<RemoteDataset> dataset = client.OpenDataset("HalfCheetah/tiny");
    REQUIRE(dataset.ok());
    (void)dataset->Sample(2, /*seed=*/7, /*first_batch=*/300, /*batches=*/1, /*with_indices=*/true);
  });
  CheckBlock("sample-request", Normalised(call.request));
  CHECK(call.payload.size() == 0);
}

TEST_CASE("the document's Step reply is what the server sends") {
  // The document's numbers are those of processors with AVX2 and FMA.
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma")) {
    WARN("skipped: this processor has no AVX2 or FMA");
    return;
  }
  Daemon daemon;
  Result<RemoteEnvironment> environment = daemon.client().Make("HalfCheetah", {.seed = 1});
  REQUIRE(environment.ok());
  REQUIRE(environment->Reset().ok());
  const Result<StepOutcome> outcome = environment->Step(kAction);
  INFO(outcome.status().ToString());
  REQUIRE(outcome.ok());
  CheckBlock("step-reply", Normalised(outcome->reply.envelope));
  CheckBlock("step-reply-arrays", outcome->reply.payload.view());
}

TEST_CASE("the document's Sample reply is what the server sends") {
  Daemon daemon;
  Result<RemoteDataset> dataset = daemon.client().OpenDataset("HalfCheetah/tiny");
  INFO(dataset.status().ToString());
  REQUIRE(dataset.ok());
  const Result<TransitionRows> rows = dataset->Sample(2, 7, 300, 1, /*with_indices=*/true);
  INFO(rows.status().ToString());
  REQUIRE(rows.ok());
  CheckBlock("sample-reply", Normalised(rows->reply->envelope));
  CheckBlock("sample-reply-arrays", rows->reply->payload.view());
}

}  // namespace
}  // namespace b4mrl
