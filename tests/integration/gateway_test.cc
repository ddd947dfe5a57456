// What the gateway promises about opening: once per token, typed refusals, a status that counts.
#include <signal.h>

#include <catch2/catch.hpp>
#include <future>
#include <map>
#include <string>

#include "client/connection.h"
#include "tests/integration/support/daemon.h"

namespace b4mrl {
namespace {

PrivateDaemon Start() { return StartDaemon({.arguments = {"--workers", "2", "--threads", "2"}}); }

pb::Request OpenRequest(const std::string& environment, uint32_t lanes) {
  pb::Request request;
  request.mutable_open()->set_environment(environment);
  request.mutable_open()->set_num_envs(lanes);
  return request;
}

class Gateway {
 public:
  explicit Gateway(const std::string& endpoint) : endpoint_(endpoint) {}

  // The answer to `request` under the session token `token`.
  Result<pb::OpenReply> Open(const pb::Request& request, const std::string& token) {
    B4MRL_ASSIGN_OR_RETURN(Connection connection, Connection::Open(context_, endpoint_, token));
    B4MRL_ASSIGN_OR_RETURN(const ReceivedReply reply,
                           connection.Call(request, Frame(), Deadline::AfterMs(30'000)));
    return reply.envelope.open();
  }

 private:
  Context context_;
  std::string endpoint_;
};

TEST_CASE("A session is opened once, however often its Open arrives") {
  PrivateDaemon daemon = Start();
  Gateway gateway(daemon.endpoint());
  const std::string token(limits::kTokenBytes, 't');
  const Result<pb::OpenReply> first = gateway.Open(OpenRequest("HalfCheetah", 4), token);
  REQUIRE(first.ok());
  REQUIRE_FALSE(first->experiment_id().empty());
  // The seed was left to the server: a second session would have another one.
  const Result<pb::OpenReply> again = gateway.Open(OpenRequest("HalfCheetah", 4), token);
  REQUIRE(again.ok());
  REQUIRE(again->SerializeAsString() == first->SerializeAsString());
  const Status other = gateway.Open(OpenRequest("HalfCheetah", 5), token).status();
  REQUIRE(other.code() == StatusCode::kInvalidArgument);
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  REQUIRE(client->ServerStatus()->session_count() == 1);
}

TEST_CASE("What cannot be opened is refused with the reason, and leaves nothing behind") {
  PrivateDaemon daemon = Start();
  Gateway gateway(daemon.endpoint());
  const auto refuse = [&](const pb::Request& request, char token) {
    return gateway.Open(request, std::string(limits::kTokenBytes, token)).status();
  };
  const Status unknown = refuse(OpenRequest("HalfCheeta", 1), 'a');
  REQUIRE(unknown.code() == StatusCode::kUnknownName);
  REQUIRE(unknown.message().find("did you mean 'HalfCheetah'") != std::string::npos);
  REQUIRE(refuse(OpenRequest("HalfCheetah", limits::kMaxLanesPerSession + 1), 'b').code() ==
          StatusCode::kInvalidArgument);
  pb::Request perturbed = OpenRequest("HalfCheetah", 1);
  perturbed.mutable_open()->add_perturbations()->set_name("gravty");
  REQUIRE(refuse(perturbed, 'c').code() == StatusCode::kUnknownName);
  pb::Request configured = OpenRequest("HalfCheetah", 1);
  configured.mutable_open()->set_config("{\"max_episode_steps\": -1}");
  REQUIRE(refuse(configured, 'd').code() == StatusCode::kInvalidArgument);
  configured.mutable_open()->set_config(std::string(limits::kMaxOpenRequestBytes, ' '));
  REQUIRE(refuse(configured, 'e').code() == StatusCode::kInvalidArgument);
  pb::Request mode = OpenRequest("HalfCheetah", 1);
  mode.mutable_open()->set_autoreset_mode(static_cast<pb::AutoresetMode>(9));
  REQUIRE(refuse(mode, 'f').code() == StatusCode::kInvalidArgument);
  REQUIRE(gateway.Open(OpenRequest("HalfCheetah", 1), "short").status().code() ==
          StatusCode::kInvalidArgument);
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  REQUIRE(client->ServerStatus()->session_count() == 0);
}

TEST_CASE("Sessions are spread over the workers, and the status counts their steps") {
  PrivateDaemon daemon = Start();
  Result<Client> client = Client::Connect(daemon.endpoint());
  REQUIRE(client.ok());
  std::vector<RemoteEnvironment> environments;
  for (int i = 0; i < 2; ++i) {
    Result<RemoteEnvironment> environment = client->Make("HalfCheetah", {.num_envs = 3});
    REQUIRE(environment.ok());
    environments.push_back(std::move(*environment));
    REQUIRE(environments.back().Reset().ok());
  }
  const std::vector<float> actions(3 * 6, 0.5f);
  REQUIRE(environments[0].Step(std::span<const float>(actions)).ok());
  Result<pb::ServerStatusReply> status = client->ServerStatus();
  REQUIRE(status.ok());
  REQUIRE(status->session_count() == 2);
  uint64_t steps = 0;
  for (const pb::WorkerStatus& worker : status->workers()) {
    if (!worker.role().starts_with("worker-")) continue;
    REQUIRE(worker.sessions() == 1);
    steps += worker.steps();
  }
  REQUIRE(steps == 3);
  REQUIRE(environments[0].Close().ok());
  REQUIRE(client->ServerStatus()->session_count() == 1);
}

TEST_CASE("A Close at another worker than the session's is refused, and ends nothing") {
  PrivateDaemon daemon = Start();
  Gateway gateway(daemon.endpoint());
  const std::string token(16, 'a');
  const pb::OpenReply own = Take(gateway.Open(OpenRequest("HalfCheetah", 1), token));
  const pb::OpenReply other =
      Take(gateway.Open(OpenRequest("HalfCheetah", 1), std::string(16, 'b')));
  REQUIRE(own.port().ipc() != other.port().ipc());
  Context context;
  const auto close_at = [&](const pb::Port& port) {
    Connection connection = Take(Connection::Open(context, "ipc://" + port.ipc(), token));
    pb::Request request;
    request.mutable_close();
    return connection.Call(std::move(request), Frame(), Deadline::AfterMs(30'000)).status();
  };
  REQUIRE(close_at(other.port()).code() == StatusCode::kSessionLost);
  REQUIRE(close_at(own.port()).ok());
  REQUIRE(close_at(other.port()).ok());  // it is not there any more
}

// The processes of the daemon whose roles begin so.
std::vector<pid_t> ProcessesOf(Client& client, const std::string& role) {
  std::vector<pid_t> processes;
  const pb::ServerStatusReply status = Take(client.ServerStatus());
  for (const pb::WorkerStatus& worker : status.workers()) {
    if (worker.role().starts_with(role))
      processes.push_back(static_cast<pid_t>(worker.process_id()));
  }
  return processes;
}

// Sends `count` Opens of one token over one connection while the workers stand still. Every one is
// answered once: with the session, or because too many wait.
void OpenAtStoppedWorkers(uint64_t count) {
  PrivateDaemon daemon = Start();
  Client client = Connect(daemon.endpoint());
  for (const pid_t worker : ProcessesOf(client, "worker-")) kill(worker, SIGSTOP);
  Context context;
  DealerSocket socket = Take(DealerSocket::Connect(context, daemon.endpoint()));
  pb::Request request = OpenRequest("HalfCheetah", 1);
  request.set_protocol_version(limits::kProtocolVersion);
  request.set_session_token(std::string(limits::kTokenBytes, 't'));
  request.set_deadline_ms(60'000);
  std::map<uint64_t, int> answers;
  uint64_t sent = 0;
  uint64_t opened = 0;
  const Deadline patience = Deadline::AfterMs(60'000);
  while (answers.size() < count && !patience.expired()) {
    // No more at once than queues on the way hold, so that none is dropped as unread.
    while (sent < count && sent - answers.size() < 512) {
      request.set_request_id(++sent);
      RequireOk(socket.Send({Take(SerializeEnvelope(request)), Frame()}));
    }
    const std::optional<Message> message = socket.Receive(patience);
    if (!message) continue;
    pb::Reply reply;
    RequireOk(ParseEnvelope(message->envelope, &reply));
    ++answers[reply.request_id()];
    const StatusCode code = GetStatus(reply.status()).code();
    CHECK((code == StatusCode::kOk || code == StatusCode::kLimitExceeded));
    opened += code == StatusCode::kOk;
  }
  REQUIRE(answers.size() == count);
  for (const auto& [id, times] : answers) REQUIRE(times == 1);
  CHECK(opened >= limits::kMaxPendingOpensOfPeer);
}

TEST_CASE("Opens for workers that stand still are all answered") { OpenAtStoppedWorkers(3'000); }

TEST_CASE("A hundred thousand Opens for workers that stand still are all answered", "[.][long]") {
  OpenAtStoppedWorkers(100'000);
}

TEST_CASE("An Open that waits while its worker dies of others' doing is answered") {
  PrivateDaemon daemon = StartDaemon({.arguments = {"--workers", "1", "--threads", "1"}});
  Client client = Connect(daemon.endpoint());
  const auto worker = [&] { return ProcessesOf(client, "worker-").at(0); };
  pid_t process = worker();
  kill(process, SIGSTOP);  // so that the Open waits
  Gateway gateway(daemon.endpoint());
  std::future<Status> opened = std::async(std::launch::async, [&] {
    return gateway.Open(OpenRequest("HalfCheetah", 1), std::string(limits::kTokenBytes, 't'))
        .status();
  });
  // Each replacement is stopped before or after it has answered; all but the last are killed.
  const Deadline patience = Deadline::AfterMs(60'000);
  for (int kills = 0; kills < 4 && !patience.expired();) {
    kill(process, SIGKILL);
    ++kills;
    pid_t next = process;
    while ((next == process || next == 0) && !patience.expired()) next = worker();
    process = next;
    if (kills < 4) kill(process, SIGSTOP);
  }
  const Status status = opened.get();
  INFO(status.ToString());
  CHECK(status.ok());
}

}  // namespace
}  // namespace b4mrl
