#include "client/client.h"

#include <fmt/format.h>
#include <sys/random.h>

#include <algorithm>
#include <cstdio>
#include <utility>

#include "proto/base/limits.h"
#include "proto/base/version.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

constexpr char kClientName[] = "b4mrl-cpp";
// Of all pages of a list together, serialised: 4 KiB for each entry of the longest catalogue
// (limits::kMaxCatalogueEntries) or list of datasets (limits::kMaxDatasets).
constexpr size_t kMaxListBytes = 16 << 20;

// A caller's deadline as the protocol has it: 0 is the default, and there is a largest one.
Result<int64_t> DeadlineInForce(std::string_view name, int64_t milliseconds) {
  if (milliseconds < 0) {
    return InvalidArgument(
        name, std::to_string(milliseconds),
        fmt::format("0..{}, where 0 means {}", limits::kMaxDeadlineMs, limits::kDefaultDeadlineMs));
  }
  if (milliseconds == 0) return limits::kDefaultDeadlineMs;
  return std::min(milliseconds, limits::kMaxDeadlineMs);
}

std::string DrawToken() {
  std::string token(limits::kTokenBytes, '\0');
  // getrandom neither interrupts nor shortens requests of up to 256 bytes (getrandom(2)).
  (void)!getrandom(token.data(), token.size(), 0);
  return token;
}

SpaceSpec SpaceOf(const pb::Space& space) {
  SpaceSpec spec;
  spec.shape.assign(space.shape().begin(), space.shape().end());
  for (const pb::Dimension& dimension : space.dimensions()) {
    spec.dimensions.push_back({dimension.name(), dimension.unit(), dimension.low(),
                               dimension.high(), dimension.feature()});
  }
  return spec;
}

uint32_t EntriesOf(const pb::CatalogueReply& catalogue) {
  return static_cast<uint32_t>(catalogue.environments_size() + catalogue.perturbations_size() +
                               catalogue.benchmarks_size());
}

// Checks the numbers from which the client computes sizes, whoever sent them.
bool HasSaneSizes(const pb::EnvironmentInfo& info) {
  const auto in_range = [](int size, uint32_t most) {
    return size > 0 && static_cast<uint32_t>(size) <= most;
  };
  return in_range(info.observation().dimensions_size(), limits::kMaxObservationDimensions) &&
         in_range(info.action().dimensions_size(), limits::kMaxActionDimensions);
}

// Counts one more page of a list, whose length the server alone decides.
Status CountPage(const ReceivedReply& page, size_t* bytes) {
  *bytes += page.envelope.ByteSizeLong();
  if (*bytes <= kMaxListBytes) return Status();
  return Status(StatusCode::kInternal,
                fmt::format("the pages of the server's list have {} bytes, allowed: at most {}",
                            *bytes, kMaxListBytes));
}

Status CheckOpenReply(const pb::OpenReply& reply, const EnvironmentOptions& options) {
  if (reply.num_envs() != options.num_envs ||
      static_cast<DType>(reply.observation_dtype()) != options.observation_dtype ||
      reply.with_infos() != options.with_infos || !HasSaneSizes(reply.info())) {
    return Status(StatusCode::kInternal, "the server's reply does not fit what was opened");
  }
  return Status();
}

Status CheckOpenReply(const pb::OpenDatasetReply& reply) {
  if (reply.fingerprint().empty() || reply.observation_size() == 0 ||
      reply.observation_size() > limits::kMaxObservationDimensions || reply.action_size() == 0 ||
      reply.action_size() > limits::kMaxActionDimensions ||
      reply.rows() > limits::kMaxDatasetRows) {
    return Status(StatusCode::kInternal, "the server's reply does not describe a dataset");
  }
  return Status();
}

Result<EnvironmentSpec> EnvironmentIn(const pb::CatalogueReply& catalogue, std::string_view name) {
  std::vector<std::string> names;
  for (const pb::EnvironmentInfo& info : catalogue.environments()) {
    if (info.name() == name && !HasSaneSizes(info)) {
      return Status(StatusCode::kInternal, "the server's reply does not describe an environment");
    }
    if (info.name() == name) return SpecOf(info);
    names.push_back(info.name());
  }
  return UnknownName("environment", name, names);
}

}  // namespace

EnvironmentSpec SpecOf(const pb::EnvironmentInfo& info) {
  EnvironmentSpec spec;
  spec.name = info.name();
  spec.observation = SpaceOf(info.observation());
  spec.action = SpaceOf(info.action());
  spec.reward = info.reward();
  spec.max_episode_steps = info.max_episode_steps();
  spec.step_seconds = info.step_seconds();
  if (info.has_reference_min()) spec.reference_min = info.reference_min();
  if (info.has_reference_max()) spec.reference_max = info.reference_max();
  spec.info_names.assign(info.info_names().begin(), info.info_names().end());
  spec.reset_info_names.assign(info.reset_info_names().begin(), info.reset_info_names().end());
  spec.picture_width = info.picture_width();
  spec.picture_height = info.picture_height();
  if (!info.has_termination()) return spec;
  spec.termination.emplace();
  for (const pb::DimensionBounds& bounds : info.termination().bounds()) {
    spec.termination->push_back(
        {bounds.dimension(), bounds.low(), bounds.high(), bounds.inclusive()});
  }
  return spec;
}

Client::Client(Context context, std::string endpoint, Connection gateway,
               const std::atomic<bool>* cancelled)
    : context_(std::move(context)),
      endpoint_(std::move(endpoint)),
      gateway_(std::move(gateway)),
      cancelled_(cancelled),
      reporter_([](const std::string& text) {
        std::fputs(("b4mrl: " + text + "\n").c_str(), stderr);  // unlike fmt::print, never throws
      }) {}

void Client::set_reporter(std::function<void(const std::string&)> reporter) {
  reporter_ = std::move(reporter);
}

void Client::DelayCancellation(Clock::duration grace) {
  grace_ = grace;
  gateway_.DelayCancellation(grace);
}

Result<Connection> Client::ConnectTo(const std::string& address, const std::string& door,
                                     const std::string& token) {
  B4MRL_ASSIGN_OR_RETURN(Connection connection,
                         Connection::OpenDoor(context_, address, door, token, cancelled_));
  connection.DelayCancellation(grace_);
  return connection;
}

Result<Client> Client::Connect(const std::string& endpoint, int64_t deadline_ms,
                               const std::atomic<bool>* cancelled) {
  B4MRL_ASSIGN_OR_RETURN(deadline_ms, DeadlineInForce("deadline_ms", deadline_ms));
  const Context context;
  B4MRL_ASSIGN_OR_RETURN(Connection gateway, Connection::Open(context, endpoint, "", cancelled));
  Client client(context, endpoint, std::move(gateway), cancelled);
  pb::Request request;
  request.mutable_hello()->set_client(fmt::format("{} {}", kClientName, ProjectVersion()));
  Result<ReceivedReply> reply =
      client.gateway_.Call(std::move(request), Frame(), Deadline::AfterMs(deadline_ms));
  if (!reply.ok()) {
    const bool is_named = reply.status().message().find(endpoint) != std::string::npos;
    return is_named ? reply.status() : reply.status().WithContext(endpoint);
  }
  client.hello_ = reply->envelope.hello();
  if (client.hello_.protocol_version() != limits::kProtocolVersion) {
    return Status(StatusCode::kVersionMismatch,
                  fmt::format("{}: the server speaks protocol {}, this client {}", endpoint,
                              client.hello_.protocol_version(), limits::kProtocolVersion));
  }
  return client;
}

Result<pb::CatalogueReply> Client::Catalogue(bool with_benchmarks) {
  const Deadline deadline = Deadline::AfterMs(limits::kDefaultDeadlineMs);  // of all pages
  size_t bytes = 0;
  pb::CatalogueReply catalogue;
  while (true) {
    const uint32_t known = EntriesOf(catalogue);
    pb::Request request;
    request.mutable_catalogue()->set_first(known);
    request.mutable_catalogue()->set_with_benchmarks(with_benchmarks);
    B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply,
                           gateway_.Call(std::move(request), Frame(), deadline));
    B4MRL_RETURN_IF_ERROR(CountPage(reply, &bytes));
    catalogue.MergeFrom(reply.envelope.catalogue());
    const uint32_t now_known = EntriesOf(catalogue);
    const bool is_all = now_known == known || now_known >= catalogue.total();
    if (is_all || now_known >= limits::kMaxCatalogueEntries) return catalogue;
  }
}

Result<pb::ServerStatusReply> Client::ServerStatus() {
  pb::Request request;
  request.mutable_server_status();
  B4MRL_ASSIGN_OR_RETURN(
      ReceivedReply reply,
      gateway_.Call(std::move(request), Frame(), Deadline::AfterMs(limits::kDefaultDeadlineMs)));
  return std::move(*reply.envelope.mutable_server_status());
}

Result<pb::LedgerReply> Client::AskLedger(uint64_t ledger) {
  pb::Request request;
  request.mutable_ledger()->set_ledger(ledger);
  B4MRL_ASSIGN_OR_RETURN(
      const ReceivedReply reply,
      gateway_.Call(std::move(request), Frame(), Deadline::AfterMs(limits::kDefaultDeadlineMs)));
  return reply.envelope.ledger();
}

Result<uint64_t> Client::OpenLedger() {
  B4MRL_ASSIGN_OR_RETURN(const pb::LedgerReply opened, AskLedger(0));
  return opened.ledger();
}

Result<LedgerCounts> Client::ReadLedger(uint64_t ledger) {
  if (ledger == 0) return InvalidArgument("ledger", "0", "the number of an open ledger");
  B4MRL_ASSIGN_OR_RETURN(const pb::LedgerReply read, AskLedger(ledger));
  return LedgerCounts{read.steps(), read.episodes(), read.query_rows(), read.dataset_rows()};
}

Result<EnvironmentSpec> Client::FindEnvironment(std::string_view name) {
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue, Catalogue());
  return EnvironmentIn(catalogue, name);
}

Result<RemoteBenchmark> Client::FindBenchmark(std::string_view name, uint64_t ledger) {
  B4MRL_ASSIGN_OR_RETURN(const pb::CatalogueReply catalogue, Catalogue(/*with_benchmarks=*/true));
  std::vector<std::string> names;
  for (const pb::BenchmarkInfo& info : catalogue.benchmarks()) {
    if (info.name() == name) {
      B4MRL_ASSIGN_OR_RETURN(EnvironmentSpec environment,
                             EnvironmentIn(catalogue, info.environment()));
      return RemoteBenchmark(this, info, std::move(environment), ledger);
    }
    names.push_back(info.name());
  }
  return UnknownName("benchmark", name, names);
}

Result<std::string> Client::AddressOf(const pb::Port& port) const {
  if (endpoint_.starts_with("ipc://")) return port.ipc().empty() ? "" : "ipc://" + port.ipc();
  if (port.tcp() == 0) return std::string();
  B4MRL_ASSIGN_OR_RETURN(const TcpAddress gateway, ParseTcpAddress(endpoint_));
  return fmt::format("tcp://{}:{}", gateway.host, port.tcp());
}

bool Client::CanRelay() const {
  const auto& capabilities = hello_.capabilities();
  return std::find(capabilities.begin(), capabilities.end(), "relay") != capabilities.end();
}

void Client::ReportRelay(const std::string& reason) {
  if (std::exchange(relayed_, true)) return;
  reporter_(fmt::format("{}; requests go through {}, which makes each of them slower", reason,
                        endpoint_));
}

Result<Connection> Client::Reach(const pb::Port& port, const std::string& token) {
  B4MRL_ASSIGN_OR_RETURN(const std::string address, AddressOf(port));
  const bool exists = !address.empty();
  if (exists && !unreachable_.contains(address)) {
    B4MRL_ASSIGN_OR_RETURN(Connection direct, ConnectTo(address, port.door(), token));
    // Without a relay, the first request waits for the connection until its deadline.
    if (!CanRelay()) return direct;
    if (direct.AwaitHandshake(Deadline::AfterMs(limits::kDirectConnectMs))) return direct;
    // The address may answer all the same.
    if (direct.IsCancelled()) return Status(StatusCode::kUnavailable, "interrupted");
    unreachable_.insert(address);
  }
  if (!CanRelay()) {
    return Status(StatusCode::kUnavailable,
                  "the server offers no port for this; is that part of it running?");
  }
  ReportRelay(
      exists ? fmt::format("{} does not answer within {} ms", address, limits::kDirectConnectMs)
             : "the server has no port of its own for this");
  B4MRL_ASSIGN_OR_RETURN(Connection relay, ConnectTo(endpoint_, "", token));
  relay.set_is_relay();
  return relay;
}

Result<RemoteEnvironment> Client::Make(const std::string& environment, EnvironmentOptions options) {
  B4MRL_ASSIGN_OR_RETURN(options.deadline_ms, DeadlineInForce("deadline_ms", options.deadline_ms));
  if (options.observation_dtype == DType::kUnspecified) options.observation_dtype = DType::kFloat32;
  pb::Request request;
  pb::OpenRequest* open = request.mutable_open();
  open->set_environment(environment);
  AddNamedArguments(options.simulator, open->mutable_perturbations());
  open->set_num_envs(options.num_envs);
  if (options.seed) open->set_seed(*options.seed);
  open->set_autoreset_mode(static_cast<pb::AutoresetMode>(options.autoreset_mode));
  open->set_observation_dtype(static_cast<pb::DType>(options.observation_dtype));
  open->set_config(options.config);
  open->set_with_infos(options.with_infos);
  open->set_ledger(options.ledger);

  // Open to the gateway and all requests to the session's worker carry the session's token.
  const std::string token = DrawToken();
  B4MRL_ASSIGN_OR_RETURN(Connection opener, ConnectTo(endpoint_, "", token));
  Result<RemoteEnvironment> session = OpenSession(opener, token, std::move(request), options);
  // The server may have opened the session already, unless it was never reached.
  if (!session.ok() && opener.connections() > 0) (void)opener.CloseSession();
  return session;
}

Result<RemoteEnvironment> Client::OpenSession(Connection& opener, const std::string& token,
                                              pb::Request request,
                                              const EnvironmentOptions& options) {
  B4MRL_ASSIGN_OR_RETURN(ReceivedReply reply, opener.Call(std::move(request), Frame(),
                                                          Deadline::AfterMs(options.deadline_ms)));
  pb::OpenReply& in_force = *reply.envelope.mutable_open();
  B4MRL_RETURN_IF_ERROR(CheckOpenReply(in_force, options));
  B4MRL_ASSIGN_OR_RETURN(Connection worker, Reach(in_force.port(), token));
  EnvironmentSpec spec = SpecOf(in_force.info());
  return RemoteEnvironment(std::move(worker), std::move(in_force), std::move(spec),
                           options.deadline_ms);
}

Result<std::vector<pb::DatasetInfo>> Client::ListDatasets() {
  B4MRL_ASSIGN_OR_RETURN(Connection worker, Reach(hello_.dataset_port(), ""));
  const Deadline deadline = Deadline::AfterMs(limits::kDefaultDeadlineMs);  // of all pages
  size_t bytes = 0;
  std::vector<pb::DatasetInfo> datasets;
  while (true) {
    pb::Request request;
    request.mutable_list_datasets()->set_first(static_cast<uint32_t>(datasets.size()));
    B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply,
                           worker.Call(std::move(request), Frame(), deadline));
    B4MRL_RETURN_IF_ERROR(CountPage(reply, &bytes));
    const pb::ListDatasetsReply& page = reply.envelope.list_datasets();
    datasets.insert(datasets.end(), page.datasets().begin(), page.datasets().end());
    const bool is_all = page.datasets().empty() || datasets.size() >= page.total();
    if (is_all || datasets.size() >= limits::kMaxDatasets) return datasets;
  }
}

Result<RemoteDataset> Client::OpenDataset(const std::string& dataset, DatasetOptions options) {
  B4MRL_ASSIGN_OR_RETURN(options.deadline_ms, DeadlineInForce("deadline_ms", options.deadline_ms));
  B4MRL_ASSIGN_OR_RETURN(options.open_deadline_ms,
                         DeadlineInForce("open_deadline_ms", options.open_deadline_ms));
  B4MRL_ASSIGN_OR_RETURN(Connection worker, Reach(hello_.dataset_port(), ""));
  pb::Request request;
  pb::OpenDatasetRequest* open = request.mutable_open_dataset();
  open->set_dataset(dataset);
  AddNamedArguments(options.corruption, open->mutable_corruptions());
  open->set_seed(options.seed);
  open->set_transition_rule(options.transition_rule);
  open->set_environment(options.environment);
  B4MRL_ASSIGN_OR_RETURN(
      ReceivedReply reply,
      worker.Call(std::move(request), Frame(), Deadline::AfterMs(options.open_deadline_ms)));
  B4MRL_RETURN_IF_ERROR(CheckOpenReply(reply.envelope.open_dataset()));
  return RemoteDataset(std::move(worker), std::move(*reply.envelope.mutable_open_dataset()),
                       options.deadline_ms, options.ledger);
}

}  // namespace b4mrl
