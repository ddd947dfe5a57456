// b4mrl-perf: what the daemon and the learners reach, each beside a limit measured in the same run.
//
//   b4mrl perf [step|latency|query|batch|update|highway|cycle|python|all] [--json] [--turns N]
//              [--endpoint ADDRESS]
//
// Exit code 0: measured (whatever the ratios are); 1: a fault of B4MRL; 2: bad usage; 3: bad input;
// 4: the daemon cannot be reached; 5: it refused; 130: interrupted.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <string>
#include <vector>

#include "algorithms/nn/products/kernel_choice.h"
#include "benchmarks/performance/benchmarks.h"
#include "benchmarks/performance/support/ping_pong.h"
#include "client/interrupt.h"
#include "proto/base/version.h"
#include "proto/command_line/program.h"
#include "proto/command_line/words.h"

namespace b4mrl::perf {
namespace {

struct Entry {
  std::string name;
  std::string about;  // what is measured, for --help
  Status (*measure)(const Options&, Reporter&);
  bool is_of_all = true;  // whether it is one of `all`
};

const std::vector<Entry>& Entries() {
  static const std::vector<Entry> kEntries = {
      {"step", "steps a second of the MuJoCo tasks through the daemon", MeasureStep},
      {"latency", "time of one step of one environment, alone and beside another client's queries",
       MeasureLatency},
      {"query", "simulated rows a second of queries from given states", MeasureQuery},
      {"batch", "time until a client has a batch of a dataset", MeasureBatch},
      {"update", "gradient steps a second of each learner, on one thread, in fp32 and bf16",
       MeasureUpdate},
      {"highway", "steps a second of Highway, bare and through the daemon", MeasureHighway},
      {"cycle",
       "seconds of 1,000 updates and their rollouts in MOPO and HyMOPO, with --rollout-lag 1 and "
       "0 and in bf16",
       MeasureCycle},
      {"python",
       "steps a second from Python, beside Gymnasium and EnvPool; needs a python3 in PATH with the "
       "package b4mrl; not one of `all`",
       MeasurePython, false}};
  return kEntries;
}

// The list of measurements below the options of --help.
std::string Footer() {
  std::string text = "Measurements:\n";
  for (const Entry& entry : Entries()) {
    text += fmt::format("  {:<10}{}\n", entry.name, entry.about);
  }
  return text + "benchmarks/RESULTS.md lists their rows and limits.";
}

int ExitCode(const Status& status) {
  switch (status.code()) {
    case StatusCode::kUnavailable:
    case StatusCode::kDeadlineExceeded:
      return 4;
    case StatusCode::kInternal:
      return 1;
    case StatusCode::kIoError:
    case StatusCode::kDataLoss:
      return 3;
    default:
      return 5;
  }
}

int Measure(const std::string& what, const Options& options, bool json) {
  Reporter reporter(json);
  bool known = false;
  for (const Entry& entry : Entries()) {
    if (what == "all" ? !entry.is_of_all : what != entry.name) continue;
    known = true;
    const Status status = entry.measure(options, reporter);
    if (!status.ok() && Interrupted()) {
      fmt::print(stderr, "b4mrl perf: interrupted\n");
      return InterruptExitCode();
    }
    // What cannot be measured with the daemon of --endpoint does not keep the rest of `all`.
    if (what == "all" && status.code() == StatusCode::kUnsupported) {
      fmt::print(stderr, "b4mrl perf: {} is left out: {}\n", entry.name, status.message());
      continue;
    }
    if (!status.ok()) {
      fmt::print(stderr, "b4mrl perf {}: {}\n", entry.name, status.ToString());
      return ExitCode(status);
    }
  }
  if (known) return 0;
  std::vector<std::string> names = {"all"};
  for (const Entry& entry : Entries()) names.push_back(entry.name);
  fmt::print(stderr, "b4mrl perf: {}\n", UnknownName("measurement", what, names).message());
  return 2;
}

int Main(int argc, char** argv) {
  // Internal command: the answering side of the bare round trip (ping_pong.h).
  if (argc == 5 && std::string_view(argv[1]) == "pong") {
    return RunPong(argv[2],
                   {std::strtoull(argv[3], nullptr, 10), std::strtoull(argv[4], nullptr, 10)});
  }
  CatchInterrupts();
  CLI::App app("Measures the daemon and the learners against the machine's own limits.",
               "b4mrl perf");
  app.set_version_flag("--version", VersionText());
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  std::string what = "all";
  Options options;
  bool json = false;
  app.footer(Footer());
  app.add_option("what", what, "one of the measurements below, or all of them")
      ->capture_default_str();
  app.add_option(
         "--endpoint", options.endpoint,
         "address of a running daemon; without `batch`, whose dataset needs a daemon of its "
         "own (default: a daemon started for the measurement)")
      ->envname("B4MRL_ENDPOINT")
      ->check(Address());
  app.add_option("--turns", options.turns, "how often a value and its limit are measured, in turns")
      ->transform(Count(1, 100))
      ->capture_default_str();
  app.add_option("--seconds", options.seconds,
                 "length of a turn in which a rate is measured, in seconds")
      ->check(Number(0.05, 60))
      ->capture_default_str();
  app.add_option("--agent", options.agent_file,
                 "agent file whose policy visits the states that queries and rollouts start from "
                 "(default: the policy of HalfCheetah/medium)")
      ->check(CLI::ExistingFile);
  app.add_flag("--json", json, "print each row as one JSON object");
  if (const auto code = ParseWords(app, {argv + 1, argv + argc})) return *code;
  return Measure(what, options, json);
}

}  // namespace
}  // namespace b4mrl::perf

int main(int argc, char** argv) {
  b4mrl::RestartWithBetterBlasKernels(argv);
  return b4mrl::RunProgram("b4mrl perf", [=] { return b4mrl::perf::Main(argc, argv); });
}
