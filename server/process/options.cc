#include "server/process/options.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>

#include "data/files/make_folder.h"
#include "data/files/toml_file.h"
#include "proto/base/cores.h"
#include "proto/base/exit_codes.h"
#include "proto/base/folders.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"
#include "proto/base/version.h"
#include "proto/command_line/words.h"

namespace b4mrl {
namespace {

// Options as the command line gives them; 0 and "" stand for options that were not given.
struct Flags {
  ServeOptions serve;
  std::string config_file;
};

uint32_t HalfOfTheMemoryMib() {
  return static_cast<uint32_t>(
      std::clamp<uint64_t>(MemoryBytes() >> 21, limits::kMinMemoryMib, limits::kMaxMemoryMib));
}

Status Complain(std::string message) {
  return Status(StatusCode::kInvalidArgument, std::move(message));
}

// Takes the options that no flag has set from the file. Checks every key, so that a misspelt key is
// an error.
Status ApplyConfigValue(const std::string& key, const toml::node& node, ServeOptions* options) {
  const auto count = [&](uint32_t* target, uint32_t most, uint32_t least = 1) -> Status {
    const std::optional<int64_t> value = node.value<int64_t>();
    if (!value || *value < least || *value > most) {
      return Complain(fmt::format("{} must be a number in {}..{}", key, least, most));
    }
    if (*target == 0) *target = static_cast<uint32_t>(*value);
    return Status();
  };
  const auto text = [&](std::string* target) -> Status {
    const std::optional<std::string> value = node.value<std::string>();
    if (!value) return Complain(fmt::format("{} must be a string", key));
    if (target->empty()) *target = *value;
    return Status();
  };
  const auto flag = [&](bool* target) -> Status {
    const std::optional<bool> value = node.value<bool>();
    if (!value) return Complain(fmt::format("{} must be true or false", key));
    *target |= *value;
    return Status();
  };
  if (key == "workers") return count(&options->workers, limits::kMaxWorkers);
  if (key == "threads") return count(&options->threads, limits::kMaxThreads);
  if (key == "lease") return count(&options->lease_seconds, limits::kMaxLeaseSeconds);
  if (key == "memory") {
    return count(&options->memory_mib, limits::kMaxMemoryMib, limits::kMinMemoryMib);
  }
  if (key == "data") return text(&options->data_folder);
  if (key == "models") return text(&options->models_folder);
  if (key == "suites") return text(&options->suites_folder);
  if (key == "insecure") return flag(&options->insecure);
  if (key == "pin") return flag(&options->pin);
  if (key == "single-port") return flag(&options->single_port);
  if (key == "no-door") return flag(&options->no_door);
  if (key == "spin") {
    const std::optional<int64_t> value = node.value<int64_t>();
    if (!value || *value < 0 || *value > limits::kMaxSpinUs) {
      return Complain(fmt::format("spin must be a number in 0..{}", limits::kMaxSpinUs));
    }
    if (!options->spin_us) options->spin_us = static_cast<uint32_t>(*value);
    return Status();
  }
  if (key == "bind") {
    const toml::array* list = node.as_array();
    std::vector<std::string> binds;
    for (size_t i = 0; list != nullptr && i < list->size(); ++i) {
      binds.push_back((*list)[i].value_or(std::string()));
    }
    if (node.is_string()) binds.push_back(node.value_or(std::string()));
    if (binds.empty()) return Complain("bind must be an address or a list of addresses");
    if (options->binds.empty()) options->binds = std::move(binds);
    return Status();
  }
  return UnknownName(
      "key", key,
      std::vector<std::string>{"bind", "workers", "threads", "lease", "memory", "pin", "data",
                               "models", "suites", "insecure", "single-port", "no-door", "spin"});
}

Status ApplyConfigFile(const std::string& path, ServeOptions* options) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table table, ReadTomlFile(path));
  for (const auto& [key, node] : table) {
    const Status status = ApplyConfigValue(std::string(key.str()), node, options);
    if (!status.ok()) return status.WithContext(path);
  }
  return Status();
}

Status CheckFolder(const char* flag, const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return IoError(fmt::format("use {}", flag), path, errno);
  if (!S_ISDIR(info.st_mode)) return IoError(fmt::format("use {}", flag), path, ENOTDIR);
  return Status();
}

Status Complete(Flags* flags) {
  ServeOptions& serve = flags->serve;
  if (!flags->config_file.empty()) {
    B4MRL_RETURN_IF_ERROR(ApplyConfigFile(flags->config_file, &serve));
  }
  if (serve.binds.empty()) serve.binds = {"tcp://127.0.0.1:7700"};
  if (serve.workers == 0) serve.workers = std::min(ProcessorCount(), 4u);
  if (!serve.spin_us) serve.spin_us = limits::kDefaultSpinUs;
  if (serve.threads == 0) serve.threads = std::min(ProcessorCount(), limits::kMaxThreads);
  if (serve.memory_mib == 0) serve.memory_mib = HalfOfTheMemoryMib();
  if (serve.data_folder.empty()) {
    serve.data_folder = DefaultDataFolder();
    // Simulators need no data, so a user without a home folder gets a daemon without datasets.
    if (const Status made = MakeFolder(serve.data_folder); !made.ok()) {
      spdlog::warn("no datasets: {}; --data or B4MRL_DATA names another folder", made.message());
    }
  } else {
    B4MRL_RETURN_IF_ERROR(CheckFolder("--data", serve.data_folder));
  }
  if (!serve.models_folder.empty()) {
    B4MRL_RETURN_IF_ERROR(CheckFolder("--models", serve.models_folder));
  }
  if (!serve.suites_folder.empty()) {
    B4MRL_RETURN_IF_ERROR(CheckFolder("--suites", serve.suites_folder));
  }
  return Status();
}

// "7701,b4mrl-2f9c.worker-0,/run/b4mrl.sock.worker-0"; a door's name holds no comma.
std::string FormatPort(const ChildOptions::Port& port) {
  return fmt::format("{},{},{}", port.tcp, port.door, port.ipc);
}
ChildOptions::Port ParsePort(const std::string& text) {
  const size_t first = std::min(text.find(','), text.size());
  const size_t second = std::min(text.find(',', first + 1), text.size());
  const Result<uint64_t> tcp = ParseUnsigned("port", text.substr(0, first), 0, 65535);
  if (second == text.size()) return {};
  return {tcp.ok() ? static_cast<uint32_t>(*tcp) : 0, text.substr(second + 1),
          text.substr(first + 1, second - first - 1)};
}

// "5=tcp://127.0.0.1:7701"
ListeningEndpoint ParseListener(const std::string& text) {
  const size_t equals = std::min(text.find('='), text.size());
  const Result<uint64_t> fd = ParseUnsigned("descriptor", text.substr(0, equals), 0, INT32_MAX);
  return {equals < text.size() ? text.substr(equals + 1) : "",
          fd.ok() ? static_cast<int>(*fd) : -1};
}

// The supervisor's arguments for a child as text, before they are parsed.
struct ChildFlags {
  std::vector<std::string> listeners;
  std::vector<std::string> worker_ports;
  std::string dataset_port;
};

void AddChildFlags(CLI::App& app, CommandLine* line, ChildFlags* flags) {
  const auto hidden = [](CLI::Option* option) { option->group(""); };
  hidden(app.add_option("--role", line->child.role));
  hidden(app.add_option("--index", line->child.index));
  hidden(app.add_option("--shared-memory", line->shared_memory_fd));
  hidden(app.add_option("--listen", flags->listeners));
  hidden(app.add_option("--door", line->child.door_listener));
  hidden(app.add_option("--worker-port", flags->worker_ports));
  hidden(app.add_option("--worker-address", line->child.worker_addresses));
  hidden(app.add_option("--dataset-port", flags->dataset_port));
  hidden(app.add_option("--dataset-address", line->child.dataset_address));
  hidden(app.add_option("--file", line->untrusted_file));
  hidden(app.add_option("--cache", line->cache_folder));
  hidden(app.add_option("--trial", line->trial_name));
  hidden(app.add_option("--cache-bytes", line->cache_bytes));
  hidden(app.add_option("--environment", line->environment));
}

void CompleteChild(const ServeOptions& serve, const ChildFlags& flags, CommandLine* line) {
  ChildOptions& child = line->child;
  line->is_child = true;
  child.threads = std::clamp(serve.threads, 1u, limits::kMaxThreads);
  child.pin = serve.pin;
  child.data_folder = serve.data_folder;
  child.models_folder = serve.models_folder;
  child.suites_folder = serve.suites_folder;
  child.spin_us = serve.spin_us.value_or(0);
  child.memory_bytes = uint64_t{serve.memory_mib} << 20;
  for (const std::string& text : flags.listeners) child.endpoints.push_back(ParseListener(text));
  for (const std::string& text : flags.worker_ports) child.worker_ports.push_back(ParsePort(text));
  child.dataset_port = ParsePort(flags.dataset_port);
}

}  // namespace

std::optional<CommandLine> ParseCommandLine(int argc, char** argv, int* exit_code) {
  CLI::App app("Serves environments, imperfect simulators and corrupted datasets until SIGTERM.",
               "b4mrl serve");
  app.set_version_flag("--version", VersionText());
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  CommandLine line;
  Flags flags;
  ServeOptions& serve = flags.serve;
  app.add_option("--bind", serve.binds,
                 "tcp://HOST:PORT or ipc://PATH; may be repeated; port 0 picks a free one "
                 "(default tcp://127.0.0.1:7700)");
  app.add_option("--workers", serve.workers, "environment workers (default: cores, at most 4)")
      ->transform(Count(1, limits::kMaxWorkers));
  app.add_option("--threads", serve.threads, "threads of each worker (default: cores)")
      ->transform(Count(1, limits::kMaxThreads));
  app.add_option("--lease", serve.lease_seconds,
                 "seconds after which a session without requests ends (default: 3600, or 300 where "
                 "other machines can connect)")
      ->transform(Count(1, limits::kMaxLeaseSeconds));
  app.add_option("--memory", serve.memory_mib,
                 "memory in MiB above which a process of the daemon is replaced (default: half of "
                 "the machine's, or of its container's)")
      ->transform(Count(limits::kMinMemoryMib, limits::kMaxMemoryMib));
  app.add_flag(
      "--pin", serve.pin,
      "keep each of these threads on one core: faster where the daemon has them to itself");
  app.add_option("--data", serve.data_folder,
                 "folder of the datasets (default $B4MRL_DATA or ~/.local/share/b4mrl)");
  app.add_option("--models", serve.models_folder,
                 "folder of MJCF models for model=FILE.xml (default: data/models)");
  app.add_option("--suites", serve.suites_folder,
                 "folder of benchmark suites (TOML), beside the project's own");
  app.add_option("--config", flags.config_file, "TOML file with the same keys; flags win");
  app.add_flag("--insecure", serve.insecure,
               "allow addresses that other machines can reach (nothing authenticates them yet)");
  app.add_flag("--single-port", serve.single_port,
               "listen on the addresses of --bind alone and relay to the workers: slower, for "
               "clients behind a tunnel, a firewall or a container's one port");
  app.add_flag("--no-door", serve.no_door,
               "offer no shared memory to clients of this machine: they use sockets, too");
  // For PrivateDaemon, whose process may be killed before it could remove the folder.
  app.add_flag("--own-folder", serve.own_folder)->group("");
  app.add_option("--spin", serve.spin_us,
                 fmt::format("longest busy wait of a worker's threads, and of clients with shared "
                             "memory, before they sleep, in microseconds; 0: none (default {})",
                             limits::kDefaultSpinUs))
      ->transform(Count(0, limits::kMaxSpinUs));
  ChildFlags child_flags;
  AddChildFlags(app, &line, &child_flags);
  if (const auto code = ParseWords(app, {argv + 1, argv + argc})) {
    *exit_code = *code;
    return std::nullopt;
  }
  if (!line.child.role.empty()) {
    CompleteChild(serve, child_flags, &line);
    return line;
  }
  if (const Status status = Complete(&flags); !status.ok()) {
    fmt::print(stderr, "b4mrl serve: {}\n", status.message());
    *exit_code = kExitBadInput;
    return std::nullopt;
  }
  line.serve = serve;
  return line;
}

std::vector<std::string> ChildArguments(const ChildOptions& child, int shared_memory_fd) {
  std::vector<std::string> arguments = {"b4mrl-serve",
                                        "--role",
                                        child.role,
                                        "--index",
                                        std::to_string(child.index),
                                        "--shared-memory",
                                        std::to_string(shared_memory_fd),
                                        "--threads",
                                        std::to_string(child.threads),
                                        "--data",
                                        child.data_folder};
  const auto add = [&](const char* flag, std::string value) {
    arguments.push_back(flag);
    arguments.push_back(std::move(value));
  };
  if (child.pin) arguments.push_back("--pin");
  if (child.door_listener >= 0) add("--door", std::to_string(child.door_listener));
  add("--spin", std::to_string(child.spin_us));
  add("--memory", std::to_string(child.memory_bytes >> 20));
  if (!child.models_folder.empty()) add("--models", child.models_folder);
  if (!child.suites_folder.empty()) add("--suites", child.suites_folder);
  for (const ListeningEndpoint& endpoint : child.endpoints) {
    add("--listen", fmt::format("{}={}", endpoint.fd, endpoint.address));
  }
  for (const ChildOptions::Port& port : child.worker_ports) add("--worker-port", FormatPort(port));
  for (const std::string& address : child.worker_addresses) add("--worker-address", address);
  add("--dataset-port", FormatPort(child.dataset_port));
  add("--dataset-address", child.dataset_address);
  return arguments;
}

}  // namespace b4mrl
