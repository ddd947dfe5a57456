#include "server/process/options.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <iterator>
#include <ranges>
#include <sstream>

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

// A key of the configuration file with its value.
struct ConfigEntry {
  std::string key;
  const toml::node& value;
};

Status Refuse(const ConfigEntry& entry, std::string_view allowed) {
  if (const auto text = entry.value.value<std::string>()) {
    return InvalidArgument(entry.key, *text, allowed);
  }
  std::ostringstream shown;
  shown << toml::toml_formatter(entry.value);
  return InvalidArgument(entry.key, shown.str(), allowed);
}

// These check a value of the file and take it.

Status TakeCount(const ConfigEntry& entry, uint32_t least, uint32_t most, uint32_t* target) {
  const std::optional<int64_t> value = entry.value.value_exact<int64_t>();
  if (!value || *value < least || *value > most) {
    return Refuse(entry, fmt::format("a number in {}..{}", least, most));
  }
  *target = static_cast<uint32_t>(*value);
  return Status();
}

Status TakeText(const ConfigEntry& entry, std::string* target) {
  const std::optional<std::string> value = entry.value.value<std::string>();
  if (!value) return Refuse(entry, "a string");
  *target = *value;
  return Status();
}

Status TakeFlag(const ConfigEntry& entry, bool* target) {
  const std::optional<bool> value = entry.value.value_exact<bool>();
  if (!value) return Refuse(entry, "true or false");
  *target = *value;
  return Status();
}

Status TakeSpin(const ConfigEntry& entry, std::optional<uint32_t>* target) {
  uint32_t spin_us = 0;
  B4MRL_RETURN_IF_ERROR(TakeCount(entry, 0, limits::kMaxSpinUs, &spin_us));
  *target = spin_us;
  return Status();
}

Status TakeBinds(const ConfigEntry& entry, std::vector<std::string>* target) {
  std::vector<std::string> binds;
  const auto add = [&](const toml::node& node) -> Status {
    const std::optional<std::string> address = node.value<std::string>();
    if (!address) return Refuse({entry.key, node}, "an address or a list of addresses");
    binds.push_back(*address);
    return Status();
  };
  const toml::array* list = entry.value.as_array();
  if (list == nullptr || list->empty()) {
    B4MRL_RETURN_IF_ERROR(add(entry.value));
  } else {
    for (const toml::node& node : *list) B4MRL_RETURN_IF_ERROR(add(node));
  }
  *target = std::move(binds);
  return Status();
}

struct ConfigKey {
  std::string_view name;
  Status (*take)(const ConfigEntry& entry, ServeOptions& to);
};
using Entry = const ConfigEntry&;
constexpr ConfigKey kConfigKeys[] = {
    {"bind", [](Entry entry, ServeOptions& to) { return TakeBinds(entry, &to.binds); }},
    {"workers",
     [](Entry entry, ServeOptions& to) {
       return TakeCount(entry, 1, limits::kMaxWorkers, &to.workers);
     }},
    {"threads",
     [](Entry entry, ServeOptions& to) {
       return TakeCount(entry, 1, limits::kMaxThreads, &to.threads);
     }},
    {"lease",
     [](Entry entry, ServeOptions& to) {
       return TakeCount(entry, 1, limits::kMaxLeaseSeconds, &to.lease_seconds);
     }},
    {"memory",
     [](Entry entry, ServeOptions& to) {
       return TakeCount(entry, limits::kMinMemoryMib, limits::kMaxMemoryMib, &to.memory_mib);
     }},
    {"cache",
     [](Entry entry, ServeOptions& to) {
       return TakeCount(entry, 1, limits::kMaxCacheMib, &to.cache_mib);
     }},
    {"pin", [](Entry entry, ServeOptions& to) { return TakeFlag(entry, &to.pin); }},
    {"data", [](Entry entry, ServeOptions& to) { return TakeText(entry, &to.data_folder); }},
    {"models", [](Entry entry, ServeOptions& to) { return TakeText(entry, &to.models_folder); }},
    {"suites", [](Entry entry, ServeOptions& to) { return TakeText(entry, &to.suites_folder); }},
    {"insecure", [](Entry entry, ServeOptions& to) { return TakeFlag(entry, &to.insecure); }},
    {"single-port", [](Entry entry, ServeOptions& to) { return TakeFlag(entry, &to.single_port); }},
    {"no-door", [](Entry entry, ServeOptions& to) { return TakeFlag(entry, &to.no_door); }},
    {"spin", [](Entry entry, ServeOptions& to) { return TakeSpin(entry, &to.spin_us); }},
};

// Whether the command line sets the flag of that name; "" stands for one that was not given.
bool IsGiven(const CLI::App& app, const std::string& name) {
  const CLI::Option* const flag = app.get_option_no_throw("--" + name);
  return flag != nullptr && std::ranges::any_of(flag->results(), [](const std::string& text) {
           return !text.empty();
         });
}

// Takes the options that no flag has set from the file. Checks every key, so that a misspelt key is
// an error.
Status ApplyConfigValue(const ConfigEntry& entry, const CLI::App& app, ServeOptions* options) {
  const auto* key = std::ranges::find(kConfigKeys, entry.key, &ConfigKey::name);
  ServeOptions checked_alone;
  if (key != std::end(kConfigKeys)) {
    return key->take(entry, IsGiven(app, entry.key) ? checked_alone : *options);
  }
  return UnknownName("key", entry.key, std::views::transform(kConfigKeys, &ConfigKey::name));
}

Status ApplyConfigFile(const std::string& path, const CLI::App& app, ServeOptions* options) {
  struct stat info {};
  if (stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) {  // a pipe would be waited for
    return InvalidArgument("--config", path, "a regular file");
  }
  B4MRL_ASSIGN_OR_RETURN(const toml::table table, ReadTomlFile(path));
  for (const auto& [key, node] : table) {
    const Status status = ApplyConfigValue({std::string(key.str()), node}, app, options);
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

Status Complete(const CLI::App& app, Flags* flags) {
  ServeOptions& serve = flags->serve;
  if (!flags->config_file.empty()) {
    B4MRL_RETURN_IF_ERROR(ApplyConfigFile(flags->config_file, app, &serve));
  }
  if (serve.binds.empty()) serve.binds = {"tcp://127.0.0.1:7700"};
  if (serve.workers == 0) serve.workers = std::min(ProcessorCount(), 4u);
  if (!serve.spin_us) serve.spin_us = limits::kDefaultSpinUs;
  if (serve.threads == 0) serve.threads = std::min(ProcessorCount(), limits::kMaxThreads);
  if (serve.memory_mib == 0) serve.memory_mib = HalfOfTheMemoryMib();
  if (serve.cache_mib == 0) serve.cache_mib = limits::kDefaultCacheMib;
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
  hidden(app.add_option("--cache-folder", line->cache_folder));
  hidden(app.add_option("--trial", line->trial_name));
  hidden(app.add_option("--cache-bytes", line->cache_bytes));
  hidden(app.add_option("--environment", line->environment));
}

void CompleteChild(const ServeOptions& serve, const ChildFlags& flags, CommandLine* line) {
  ChildOptions& child = line->child;
  line->is_child = true;
  static_cast<CommonOptions&>(child) = serve;
  child.threads = std::clamp(serve.threads, 1u, limits::kMaxThreads);
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
  app.add_option("--cache", serve.cache_mib,
                 fmt::format("disk in MiB that the caches of all datasets may take (default {})",
                             limits::kDefaultCacheMib))
      ->transform(Count(1, limits::kMaxCacheMib));
  app.add_flag(
      "--pin", serve.pin,
      "keep each of these threads on one core: faster where the daemon has them to itself");
  app.add_option("--data", serve.data_folder,
                 "folder of the datasets (default $B4MRL_DATA, else $XDG_DATA_HOME/b4mrl, else "
                 "~/.local/share/b4mrl)");
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
  if (const Status status = Complete(app, &flags); !status.ok()) {
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
  add("--spin", std::to_string(child.spin_us.value_or(0)));
  add("--memory", std::to_string(child.memory_mib));
  add("--cache", std::to_string(child.cache_mib));
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
