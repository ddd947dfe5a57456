// b4mrl status, of a daemon that the test plays.
#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>
#include <utility>

#include "tests/algorithms/tools/tool.h"
#include "tests/client/fake_daemon.h"

namespace b4mrl {
namespace {

TEST_CASE("status tells the daemon's version, and with --check fails where a process is down") {
  const FakeDaemon daemon([](FakeServer& server, FakeCall& call) {
    if (!call.request.has_server_status()) return false;
    pb::Reply reply;
    pb::ServerStatusReply* status = reply.mutable_server_status();
    pb::WorkerStatus* gateway = status->add_workers();
    gateway->set_role("gateway");
    gateway->set_process_id(7);
    pb::WorkerStatus* worker = status->add_workers();
    worker->set_role("worker-0");
    worker->set_restarts(12);
    server.Reply(call, std::move(reply));
    return true;
  });
  const Outcome plain = Run({"status", "--endpoint", daemon.address()});
  CHECK(plain.exit_code == 0);
  CHECK(plain.out.starts_with("b4mrl "));
  const Outcome checked = Run({"status", "--check", "--json", "--endpoint", daemon.address()});
  CHECK(checked.exit_code == 4);
  CHECK(checked.err.find("worker-0 does not run; it was restarted 12 times") != std::string::npos);
  CHECK(nlohmann::json::parse(checked.out).contains("version"));
}

}  // namespace
}  // namespace b4mrl
