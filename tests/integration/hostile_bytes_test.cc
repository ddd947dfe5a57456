// 100,000 spoilt messages and raw garbage on every socket of a daemon. Nothing may crash, hang,
// grow or be answered twice, every definite mistake gets its own kind of error, and a session that
// steps meanwhile notices nothing.
#include <atomic>
#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <map>
#include <thread>

#include "proto/base/limits.h"
#include "tests/data/example_dataset.h"
#include "tests/data/temporary_folder.h"
#include "tests/integration/support/daemon.h"
#include "tests/integration/support/lane_walk.h"
#include "tests/integration/support/message_mutator.h"

namespace b4mrl {
namespace {

constexpr int kGatewayMutants = 35'000;
constexpr int kWorkerMutants = 43'000;
constexpr int kDatasetMutants = 20'000;
constexpr int kRelayedMutants = 3'000;  // to a worker, and as many to the dataset worker
// A session may have 64 requests in flight; more would be refused for that reason alone.
constexpr int kBatch = 48;
constexpr int64_t kPatienceMs = 30'000;
constexpr uint32_t kGroups = 2;
constexpr uint32_t kLanesPerGroup = 2;
constexpr uint32_t kVictimLanes = 2;
// What one process may grow by while it answers the flood: caches of sessions that mutants opened,
// and what an allocator keeps. AddressSanitizer's keeps 256 MiB of freed memory.
#ifdef __SANITIZE_ADDRESS__
constexpr int64_t kMaxGrowthBytes = 512 << 20;
#else
constexpr int64_t kMaxGrowthBytes = 96 << 20;
#endif

PrivateDaemon StartVictim(const std::string& data_folder) {
  return StartDaemon(
      {.tcp = true, .data_folder = data_folder, .arguments = {"--workers", "1", "--threads", "2"}});
}

// ---- The corpora: what is well-formed -----------------------------------------------------------

// A request under construction, its arrays filled with a function of their position.
class TemplateBuilder {
 public:
  explicit TemplateBuilder(const std::string& token) {
    request_.set_protocol_version(limits::kProtocolVersion);
    request_.set_session_token(token);
    request_.set_deadline_ms(20'000);
  }
  pb::Request& request() { return request_; }
  template <typename T>
  void Add(const std::string& name, std::vector<T> values, std::initializer_list<uint64_t> shape) {
    ArrayLayout layout(request_.mutable_arrays(), payload_.size());
    const size_t offset = layout.Add(name, DTypeOf<T>(), shape);
    payload_.resize(offset);
    payload_.append(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T));
  }
  RequestTemplate Build() { return {request_, payload_}; }

 private:
  pb::Request request_;
  std::string payload_;
};

// A session whose lanes have been reset once, opened and driven message by message.
struct Victim {
  std::string token;
  pb::OpenRequest open;
  std::string address;  // of its worker
};

Victim OpenVictim(Context& context, const std::string& endpoint, char name) {
  Victim victim;
  victim.token = std::string(limits::kTokenBytes, name);
  victim.open.set_environment("HalfCheetah");
  victim.open.set_num_envs(kVictimLanes);
  victim.open.set_seed(1);
  pb::NamedArgument* gravity = victim.open.add_perturbations();
  gravity->set_name("gravity");
  gravity->set_argument("2");
  Result<Connection> gateway = Connection::Open(context, endpoint, victim.token);
  RequireOk(gateway.status());
  pb::Request request;
  *request.mutable_open() = victim.open;
  Result<ReceivedReply> opened =
      gateway->Call(std::move(request), Frame(), Deadline::AfterMs(kPatienceMs));
  RequireOk(opened.status());
  victim.address = "tcp://127.0.0.1:" + std::to_string(opened->envelope.open().port().tcp());

  Result<Connection> worker = Connection::Open(context, victim.address, victim.token);
  RequireOk(worker.status());
  TemplateBuilder reset(victim.token);
  reset.request().mutable_reset();
  reset.Add<uint64_t>("numbers", std::vector<uint64_t>(kVictimLanes, 1), {kVictimLanes});
  const RequestTemplate message = reset.Build();
  RequireOk(
      worker->Call(message.request, Frame::Copy(message.payload), Deadline::AfterMs(kPatienceMs))
          .status());
  return victim;
}

std::vector<RequestTemplate> GatewayCorpus(const Victim& victim, uint64_t ledger_number) {
  std::vector<RequestTemplate> corpus;
  TemplateBuilder hello("");
  hello.request().mutable_hello()->set_client("test");
  TemplateBuilder catalogue("");
  catalogue.request().mutable_catalogue();
  TemplateBuilder status("");
  status.request().mutable_server_status();
  TemplateBuilder ledger("");
  ledger.request().mutable_ledger()->set_ledger(ledger_number);
  TemplateBuilder open(victim.token);
  *open.request().mutable_open() = victim.open;
  for (TemplateBuilder* builder : {&hello, &catalogue, &status, &ledger, &open, &open, &open}) {
    corpus.push_back(builder->Build());
  }
  return corpus;
}

// Of operation `number`, which is each lane's next one until a mutant happens to be well-formed,
// and its last one from then on.
template <typename Fill>
RequestTemplate LaneTemplate(const std::string& token, const Fill& fill) {
  TemplateBuilder builder(token);
  builder.Add<uint64_t>("numbers", std::vector<uint64_t>(kVictimLanes, 2), {kVictimLanes});
  builder.Add<uint32_t>("lanes", {0, 1}, {kVictimLanes});
  fill(builder);
  return builder.Build();
}

// One victim for each operation, so that a number always belongs to the same one.
std::vector<RequestTemplate> WorkerCorpus(const Victim& stepped, const Victim& reset,
                                          const Victim& restored,
                                          const std::vector<uint8_t>& snapshot) {
  std::vector<RequestTemplate> corpus;
  corpus.push_back(LaneTemplate(stepped.token, [](TemplateBuilder& builder) {
    builder.request().mutable_step();
    builder.Add<float>("actions", std::vector<float>(kVictimLanes * 6, 0.25f), {kVictimLanes, 6});
  }));
  corpus.push_back(LaneTemplate(reset.token, [](TemplateBuilder& builder) {
    builder.request().mutable_reset();
    builder.Add<uint64_t>("seeds", {5, 6}, {kVictimLanes});
  }));
  corpus.push_back(LaneTemplate(restored.token, [&snapshot](TemplateBuilder& builder) {
    builder.request().mutable_restore();
    builder.Add<uint8_t>("snapshot", snapshot, {kVictimLanes, snapshot.size() / kVictimLanes});
  }));
  corpus.push_back(LaneTemplate(restored.token, [](TemplateBuilder& builder) {
    builder.request().mutable_restore();
    builder.Add<double>("qpos", std::vector<double>(kVictimLanes * 9, 0.1), {kVictimLanes, 9});
    builder.Add<double>("qvel", std::vector<double>(kVictimLanes * 9, 0.2), {kVictimLanes, 9});
  }));
  TemplateBuilder query(stepped.token);
  query.request().mutable_query()->set_seed(3);
  query.Add<float>("observations", std::vector<float>(4 * 17, 0.1f), {4, 17});
  query.Add<float>("actions", std::vector<float>(4 * 6, 0.1f), {4, 6});
  corpus.push_back(query.Build());
  TemplateBuilder take(reset.token);
  take.request().mutable_snapshot();
  take.Add<uint32_t>("lanes", {0, 1}, {kVictimLanes});
  corpus.push_back(take.Build());
  return corpus;
}

std::vector<RequestTemplate> DatasetCorpus(const std::string& fingerprint) {
  std::vector<RequestTemplate> corpus;
  TemplateBuilder list(""), open(""), stats(""), sample(""), read("");
  list.request().mutable_list_datasets();
  open.request().mutable_open_dataset()->set_dataset("Example/small");
  stats.request().mutable_dataset_stats()->set_fingerprint(fingerprint);
  pb::SampleRequest* batch = sample.request().mutable_sample();
  batch->set_fingerprint(fingerprint);
  batch->set_seed(4);
  batch->set_batches(2);
  batch->set_rows(16);
  batch->set_with_indices(true);
  pb::ReadRequest* rows = read.request().mutable_read();
  rows->set_fingerprint(fingerprint);
  rows->set_first_row(10);
  rows->set_rows(20);
  for (TemplateBuilder* builder : {&list, &open, &stats, &sample, &sample, &read, &read}) {
    corpus.push_back(builder->Build());
  }
  return corpus;
}

// ---- The flood ----------------------------------------------------------------------------------

// Checks the reply to one of `mutants`, which are in flight together.
void CheckReply(const Message& message, std::map<uint64_t, Mutant>* mutants) {
  pb::Reply reply;
  RequireOk(ParseEnvelope(message.envelope, &reply));
  REQUIRE(reply.protocol_version() == limits::kProtocolVersion);
  if (reply.status().code() != 0) REQUIRE_FALSE(reply.status().message().empty());
  const auto found = mutants->find(reply.request_id());
  if (found == mutants->end()) return;  // of an envelope that was damaged
  const Mutant mutant = std::move(found->second);
  mutants->erase(found);
  if (mutant.allowed.empty()) return;
  const StatusCode code = static_cast<StatusCode>(reply.status().code());
  INFO(mutant.damage << " was answered with " << StatusCodeName(code) << ": "
                     << reply.status().message());
  pb::Request request;
  request.ParseFromString(mutant.envelope);
  INFO(request.ShortDebugString());
  REQUIRE(std::count(mutant.allowed.begin(), mutant.allowed.end(), code) == 1);
}

// Sends `count` mutants, some in flight together, and demands exactly one reply for each.
void Flood(Context& context, const std::string& address, MessageMutator mutator, int count) {
  Result<DealerSocket> socket = DealerSocket::Connect(context, address);
  RequireOk(socket.status());
  for (int sent = 0; sent < count;) {
    std::map<uint64_t, Mutant> mutants;
    int unanswered = 0;
    for (; unanswered < kBatch && sent < count; ++unanswered, ++sent) {
      Mutant mutant = mutator.Next();
      RequireOk(socket->Send({Frame::Copy(mutant.envelope), Frame::Copy(mutant.payload)}));
      if (mutant.request_id != 0) mutants[mutant.request_id] = std::move(mutant);
    }
    const Deadline deadline = Deadline::AfterMs(kPatienceMs);
    while (unanswered > 0) {
      const std::optional<Message> message = socket->TryReceive();
      if (!message) {
        CAPTURE(sent, unanswered, mutants.empty() ? "damaged" : mutants.begin()->second.damage);
        REQUIRE_FALSE(deadline.expired());
        socket->Wait(deadline);
        continue;
      }
      CheckReply(*message, &mutants);
      --unanswered;
    }
    INFO((mutants.empty() ? "" : mutants.begin()->second.damage) << " was not answered by its id");
    REQUIRE(mutants.empty());
    REQUIRE_FALSE(socket->TryReceive().has_value());
  }
}

// ---- What must not happen -----------------------------------------------------------------------

// Private memory of each child by role; what it shares with the others does not count.
std::map<std::string, int64_t> PrivateBytes(Client& client) {
  std::map<std::string, int64_t> bytes;
  const Result<pb::ServerStatusReply> status = client.ServerStatus();
  RequireOk(status.status());
  for (const pb::WorkerStatus& child : status->workers()) {
    REQUIRE(child.restarts() == 0);
    std::ifstream file("/proc/" + std::to_string(child.process_id()) + "/status");
    std::string word;
    while (file >> word) {
      if (word == "RssAnon:") file >> bytes[child.role()];
    }
    bytes[child.role()] *= 1024;
  }
  return bytes;
}

// A session that steps on a thread of its own until it is told to stop.
class Bystander {
 public:
  explicit Bystander(const std::string& endpoint) : client_(Client::Connect(endpoint)) {
    RequireOk(client_.status());
    walk_ = std::make_unique<LaneWalk>(Open(*client_));
    thread_ = std::thread([this] {
      while (!stop_ && status_.ok()) status_ = walk_->Advance();
      if (status_.ok()) status_ = walk_->Drain();
    });
  }
  ~Bystander() { Stop(); }
  static LaneWalk Open(Client& client) {
    Result<LaneWalk> walk = LaneWalk::Open(client, kGroups, kLanesPerGroup, 77);
    RequireOk(walk.status());
    RequireOk(walk->Reset());
    return std::move(*walk);
  }
  void Stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  const Status& status() const { return status_; }
  LaneWalk& walk() { return *walk_; }

 private:
  Result<Client> client_;
  std::unique_ptr<LaneWalk> walk_;
  Status status_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// The same steps in a daemon that nobody disturbs.
void RequireUndisturbed(Bystander& bystander, const std::string& data_folder) {
  bystander.Stop();
  RequireOk(bystander.status());
  const uint64_t steps = bystander.walk().FinishedSteps();
  REQUIRE(steps > 50);
  PrivateDaemon quiet = StartVictim(data_folder);
  Result<Client> client = Client::Connect(quiet.endpoint());
  RequireOk(client.status());
  LaneWalk reference = Bystander::Open(*client);
  RequireOk(reference.RunTo(steps));
  for (uint32_t lane = 0; lane < kGroups * kLanesPerGroup; ++lane) {
    REQUIRE(bystander.walk().Bytes(lane, steps) == reference.Bytes(lane, steps));
  }
}

TEST_CASE("Spoilt messages by the thousand change, stop and grow nothing") {
  const TemporaryFolder data;
  std::filesystem::create_directories(data.File("Example"));
  RequireOk(WriteExample(data.File("Example/small.h5"), MakeExampleDataset({40, 50, 60})));
  PrivateDaemon daemon = StartVictim(data.path());
  Result<Client> client = Client::Connect(daemon.endpoint());
  RequireOk(client.status());
  Result<RemoteDataset> dataset = client->OpenDataset("Example/small");
  RequireOk(dataset.status());
  const std::string dataset_address =
      "tcp://127.0.0.1:" + std::to_string(client->hello().dataset_port().tcp());
  EnvironmentOptions options{.simulator = {{"gravity", "2"}}, .num_envs = kVictimLanes};
  Result<RemoteEnvironment> source = client->Make("HalfCheetah", options);
  RequireOk(source.status());
  RequireOk(source->Reset().status());
  const Result<LaneStates> snapshot = source->Snapshot();
  RequireOk(snapshot.status());
  const Result<uint64_t> ledger = client->OpenLedger();
  RequireOk(ledger.status());

  Context context;
  const Victim stepped = OpenVictim(context, daemon.endpoint(), 's');
  const Victim reset = OpenVictim(context, daemon.endpoint(), 'r');
  const Victim restored = OpenVictim(context, daemon.endpoint(), 't');
  const std::vector<RequestTemplate> gateway = GatewayCorpus(stepped, *ledger);
  const std::vector<RequestTemplate> worker =
      WorkerCorpus(stepped, reset, restored, snapshot->snapshot);
  const std::vector<RequestTemplate> datasets = DatasetCorpus(dataset->fingerprint());

  pb::Request attach = worker[0].request;  // what the gateway neither answers nor passes on
  attach.mutable_attach();

  Bystander bystander(daemon.endpoint());
  std::map<std::string, int64_t> before;
  // The first tenth fills caches and pools.
  for (const int tenths : {1, 9}) {
    const uint64_t seed = static_cast<uint64_t>(tenths);
    Flood(context, daemon.endpoint(), MessageMutator(gateway, worker[0].request, seed),
          kGatewayMutants * tenths / 10);
    Flood(context, stepped.address, MessageMutator(worker, gateway[0].request, seed),
          kWorkerMutants * tenths / 10);
    Flood(context, dataset_address, MessageMutator(datasets, gateway[0].request, seed),
          kDatasetMutants * tenths / 10);
    for (const auto& relayed : {worker, datasets}) {
      Flood(context, daemon.endpoint(), MessageMutator(relayed, attach, seed + 100),
            kRelayedMutants * tenths / 10);
    }
    if (before.empty()) before = PrivateBytes(*client);
  }
  const std::map<std::string, int64_t> after = PrivateBytes(*client);
  REQUIRE(after.size() == 3);
  for (const auto& [role, bytes] : after) {
    CAPTURE(role, bytes, before.at(role));
    REQUIRE(bytes > 0);
    REQUIRE(bytes - before.at(role) < kMaxGrowthBytes);
  }
  RequireUndisturbed(bystander, data.path());
  // Everything is still served.
  RequireOk(client->Make("HalfCheetah", {}).status());
  RequireOk(dataset->Sample(32, 1, 0).status());
}

}  // namespace
}  // namespace b4mrl
