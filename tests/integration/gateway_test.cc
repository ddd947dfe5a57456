// What the gateway promises about opening: once per token, typed refusals, a status that counts.
#include <catch2/catch.hpp>
#include <filesystem>
#include <string>

#include "client/connection.h"
#include "tests/integration/daemon.h"

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

}  // namespace
}  // namespace b4mrl
