// Runs that need more memory than there is.
#include <sys/resource.h>

#include <catch2/catch.hpp>
#include <string>

#include "algorithms/run/run_result.h"
#include "client/private_daemon.h"
#include "tests/algorithms/tools/tool.h"
#include "tests/resource_limit.h"

// The sanitizers' shadow memory takes more than any limit.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
namespace b4mrl {
namespace {

TEST_CASE("A run that needs more memory than there is fails and says so") {
  const TemporaryFolder folder;
  PrivateDaemonOptions options;
  options.binary = B4MRL_BINARY_DIR "/b4mrl-serve";
  options.data_folder = folder.File("data");
  std::filesystem::create_directories(options.data_folder);
  Result<PrivateDaemon> daemon = PrivateDaemon::Start(options);
  REQUIRE(daemon.ok());
  const std::string run = folder.File("run");
  // A training has half a GiB of addresses with small networks; these want 20 GiB for batches.
  const ResourceLimit limit(RLIMIT_AS, 1 << 30);
  const Outcome outcome = Run({"train", "--algorithm", "sac", "--environment", "HalfCheetah",
                               "--batch-size", "65536", "--hidden-width", "2048", "--hidden-layers",
                               "8", "--out", run, "--endpoint", daemon->endpoint()});
  INFO(outcome.err);
  CHECK(outcome.exit_code == 1);
  CHECK(outcome.err.find("not enough memory for these networks, batch and data") !=
        std::string::npos);
  const Result<RunStatus> status = ReadRunStatus(run);
  REQUIRE(status.ok());
  CHECK(status->state == RunState::kFailed);
  CHECK(status->reason.find("not enough memory") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
#endif
