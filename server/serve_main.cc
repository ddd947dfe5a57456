#include "server/serve_main.h"

#include <fmt/format.h>
#include <google/protobuf/stubs/logging.h>
#include <spdlog/cfg/env.h>
#include <spdlog/spdlog.h>
#include <sys/prctl.h>
#include <sys/stat.h>

#include <cstdio>
#include <cstdlib>
#include <system_error>

#include "data/suites/suites.h"
#include "proto/base/exit_codes.h"
#include "server/datasets/dataset_worker.h"
#include "server/datasets/importer.h"
#include "server/environments/mujoco/engine_version.h"
#include "server/gateway/suite_check.h"
#include "server/log/stderr_log.h"
#include "server/models/model_compiler.h"
#include "server/process/child.h"
#include "server/process/options.h"
#include "server/supervisor/supervisor.h"

namespace b4mrl {
namespace {

Status RunRole(ChildContext& context) {
  const std::string& role = context.options().role;
  try {
    if (role == "gateway") return RunGateway(context);
    if (role == "worker") return RunWorker(context);
    if (role == "dataset-worker") return RunDatasetWorker(context);
  } catch (const std::system_error& error) {
    // Thrown by std::thread. A child starts its threads before it reads its first message.
    if (error.code() != std::errc::resource_unavailable_try_again) throw;
    return Status(StatusCode::kFailedPrecondition,
                  "the system starts no more threads (ulimit -u, ulimit -v); allowed: fewer "
                  "--workers or --threads");
  }
  return InvalidArgument("--role", role, "a known role");
}

// As `top`, `pgrep` and the system's log of what it killed for memory know the process: executed as
// /proc/self/exe, it would be "exe".
void NameProcess(const std::string& name) { prctl(PR_SET_NAME, ("b4mrl-" + name).c_str()); }

int RunChild(CommandLine line) {
  const std::string name = line.child.role == "worker"
                               ? ChildName(kFirstWorkerChild + line.child.index)
                               : line.child.role;
  NameProcess(name);
  spdlog::default_logger()->set_pattern(kLogTime + ("b4mrl " + name + ": %v"));
  // Protobuf would write a line for every malformed message that a peer sends.
  google::protobuf::SetLogHandler(nullptr);
  Result<SharedState> shared = SharedState::Map(line.shared_memory_fd);
  if (!shared.ok()) {
    spdlog::error(shared.status().ToString());
    return kExitBadInput;
  }
  ChildContext context(std::move(line.child), std::move(*shared));
  const Status status = RunRole(context);
  if (status.ok()) return kExitDone;
  spdlog::error(status.ToString());
  return kExitBadInput;
}

// Leaves without running exit handlers, such as a sanitizer's search for leaks, which may need
// rights that the sandbox has taken.
[[noreturn]] void LeaveSandbox(int exit_code) {
  std::fflush(nullptr);
  std::_Exit(exit_code);
}

}  // namespace

int ServeMain(int argc, char** argv) {
  // Sockets, caches and folders are accessible to this user alone; children inherit the umask.
  umask(S_IRWXG | S_IRWXO);
  LogToStderr("b4mrl serve: %v");
  spdlog::cfg::load_env_levels();  // SPDLOG_LEVEL
  int exit_code = kExitDone;
  std::optional<CommandLine> line = ParseCommandLine(argc, argv, &exit_code);
  if (!line) return exit_code;
  if (line->child.role == "importer") {
    NameProcess("importer");
    LeaveSandbox(RunImporter({line->untrusted_file, line->cache_folder, line->cache_bytes}));
  }
  if (line->child.role == "model-compiler") {
    NameProcess("compiler");
    LeaveSandbox(RunModelCompiler({line->child.models_folder, line->untrusted_file,
                                   line->environment, line->cache_folder, line->trial_name}));
  }
  if (line->is_child) return RunChild(std::move(*line));
  if (const Status engine = CheckEngineVersion(); !engine.ok()) {
    fmt::print(stderr, "b4mrl serve: {}\n", engine.message());
    return kExitFailed;
  }
  // A mistake in a suite is told to who starts the daemon; its gateway reads the suites later.
  const auto suites = ReadSuites({DefaultSuitesFolder(), line->serve.suites_folder});
  const Status sound = suites.ok() ? CheckSuites(*suites) : suites.status();
  if (!sound.ok()) {
    fmt::print(stderr, "b4mrl serve: {}\n", sound.message());
    return kExitBadInput;
  }
  return RunSupervisor(line->serve);
}

}  // namespace b4mrl
