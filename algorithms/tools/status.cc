// b4mrl status: what a running daemon is doing.
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "algorithms/base/progress.h"
#include "algorithms/tools/command.h"

namespace b4mrl {
namespace {

using Json = nlohmann::ordered_json;

void PrintJson(const std::string& version, const pb::ServerStatusReply& status) {
  Json out = {{"version", version},
              {"uptime_ms", status.uptime_ms()},
              {"data_folder", status.data_folder()},
              {"session_count", status.session_count()},
              {"workers", Json::array()},
              {"sessions", Json::array()}};
  for (const pb::WorkerStatus& worker : status.workers()) {
    out["workers"].push_back({{"role", worker.role()},
                              {"process_id", worker.process_id()},
                              {"restarts", worker.restarts()},
                              {"sessions", worker.sessions()},
                              {"steps", worker.steps()},
                              {"query_rows", worker.query_rows()},
                              {"requests", worker.requests()},
                              {"errors", worker.errors()},
                              {"steps_per_second", worker.steps_per_second()}});
  }
  for (const pb::SessionStatus& session : status.sessions()) {
    out["sessions"].push_back({{"environment", session.environment()},
                               {"perturbations", session.perturbations()},
                               {"num_envs", session.num_envs()},
                               {"worker", session.worker()},
                               {"steps", session.steps()},
                               {"idle_ms", session.idle_ms()}});
  }
  fmt::print("{}\n", out.dump(2, ' ', false, Json::error_handler_t::replace));
}

void PrintText(const std::string& version, const pb::ServerStatusReply& status) {
  fmt::print("b4mrl {}, up {}, {} sessions, data in {}\n", version,
             FormatDuration(static_cast<double>(status.uptime_ms()) / 1000), status.session_count(),
             status.data_folder());
  fmt::print("{:<16} {:>8} {:>8} {:>8} {:>12} {:>10} {:>12} {:>8}\n", "process", "pid", "restarts",
             "sessions", "steps", "steps/s", "query rows", "errors");
  for (const pb::WorkerStatus& worker : status.workers()) {
    fmt::print("{:<16} {:>8} {:>8} {:>8} {:>12} {:>10.0f} {:>12} {:>8}\n", worker.role(),
               worker.process_id(), worker.restarts(), worker.sessions(), worker.steps(),
               worker.steps_per_second(), worker.query_rows(), worker.errors());
  }
  for (const pb::SessionStatus& session : status.sessions()) {
    fmt::print("session {}[{}] x{} on worker {}: {} steps, idle {}\n", session.environment(),
               session.perturbations(), session.num_envs(), session.worker(), session.steps(),
               FormatDuration(static_cast<double>(session.idle_ms()) / 1000));
  }
}

struct StatusCommand {
  std::string endpoint = "tcp://127.0.0.1:7700";
  bool json = false;
  bool check = false;

  std::optional<Failure> Run() {
    DaemonOptions daemon;
    daemon.endpoint = endpoint;
    auto connection = DaemonConnection::Open(daemon);
    if (!connection.ok()) return Failure{kExitNoDaemon, connection.status()};
    const auto status = connection->client().ServerStatus();
    if (!status.ok()) return FromDaemon(status.status());
    const std::string& version = connection->client().hello().server_version();
    json ? PrintJson(version, *status) : PrintText(version, *status);
    for (const pb::WorkerStatus& worker : status->workers()) {
      if (!check || worker.process_id() != 0) continue;
      return Failure{kExitNoDaemon, Status(StatusCode::kUnavailable,
                                           fmt::format("{} does not run; it was restarted {} times",
                                                       worker.role(), worker.restarts()))};
    }
    return std::nullopt;
  }
};

}  // namespace

std::vector<Command> AddStatusCommand(CLI::App& app) {
  auto command = std::make_shared<StatusCommand>();
  CLI::App* sub = app.add_subcommand("status", "a running daemon's sessions, workers and rates");
  const CLI::Option* const option =
      AddEndpoint(*sub, command->endpoint, "address of the daemon [tcp://127.0.0.1:7700]");
  sub->parse_complete_callback([command, option] { CheckEndpoint(*option, command->endpoint); });
  sub->add_flag("--json", command->json, "print the status as one JSON object");
  sub->add_flag("--check", command->check,
                "exit code 4 also where a process of the daemon is down");
  return {{sub, [command] { return command->Run(); }}};
}

}  // namespace b4mrl
