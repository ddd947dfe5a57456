// b4mrl-tools: the client side of the command line, which users start by `b4mrl` (launcher.cc).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <utility>
#include <vector>

#include "algorithms/base/within_memory.h"
#include "algorithms/nn/products/kernel_choice.h"
#include "algorithms/tools/command.h"
#include "algorithms/tools/config_file.h"
#include "client/interrupt.h"
#include "proto/base/version.h"
#include "proto/command_line/program.h"
#include "proto/command_line/shell_word.h"
#include "proto/command_line/words.h"

namespace b4mrl {
namespace {

constexpr const char* kDescription =
    "B4MRL: simulators, datasets and learners for hybrid reinforcement learning";

std::string CommandLine(int argc, char** argv) {
  std::string line = "b4mrl";
  for (int i = 1; i < argc; ++i) line += " " + ShellWord(argv[i]);
  return line;
}

int Report(const Failure& failure) {
  // After Ctrl-C, print the message without the error's code.
  const bool is_error = failure.exit_code != kExitInterrupted;
  fmt::print(stderr, "b4mrl: {}\n",
             is_error ? failure.status.ToString() : failure.status.message());
  return failure.exit_code;
}

// Adds the commands that the launcher (launcher.cc) handles, only so that the help lists them.
std::vector<Command> AddOtherPrograms(CLI::App& app) {
  std::vector<Command> commands;
  for (const auto& [name, description] :
       {std::pair{"serve", "run the daemon (b4mrl serve --help)"},
        std::pair{"benchmark",
                  "train what fills the tables of benchmarks (b4mrl benchmark --help)"},
        {"report", "tables, figures and claims from results (b4mrl report --help)"},
        std::pair{"perf", "measure the daemon against the machine's limits (b4mrl perf --help)"},
        std::pair{"help", "show a command's help: b4mrl help train"}}) {
    const Status status(StatusCode::kUnsupported,
                        fmt::format("'{0}' is for the launcher: b4mrl {0}", name));
    commands.push_back(
        {app.add_subcommand(name, description), [status] { return BadUsage(status); }});
  }
  return commands;
}

int RunBody(const CommandBody& body) {
  std::optional<Failure> failure;
  const Status memory = WithinMemory("this command", [&] {
    failure = body();
    return Status();
  });
  if (!memory.ok()) failure = Failure{kExitFailed, memory};
  if (!failure) return kExitDone;
  // Other errors after an interrupt are reported, such as a checkpoint on a full disk.
  const bool by_interrupt = failure->status.code() == StatusCode::kUnavailable;
  if (Interrupted() && by_interrupt && failure->exit_code != kExitInterrupted) {
    fmt::print(stderr, "b4mrl: interrupted\n");
    return InterruptExitCode();
  }
  return Report(*failure);
}

// The words with the options of their configuration file, where the command that they begin with
// takes one. Other commands refuse --config as they do every unknown option.
Result<std::vector<std::string>> ExpandedWords(const CLI::App& app,
                                               std::vector<std::string> words) {
  const auto takes_file = [&](const CLI::App* command) {
    return command->get_name() == words.front() &&
           command->get_option_no_throw("--config") != nullptr;
  };
  if (words.empty() || app.get_subcommands(takes_file).empty()) return words;
  return ExpandConfigFile(std::move(words));
}

int Run(int argc, char** argv) {
  CLI::App app(kDescription, "b4mrl");
  app.require_subcommand(1);
  app.set_version_flag("--version", VersionText());
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  std::vector<Command> commands;
  for (auto& added : {AddTrainCommand(app, CommandLine(argc, argv)), AddEvaluateCommand(app),
                      AddDatasetCommands(app), AddDemoCommands(app), AddListCommand(app),
                      AddStatusCommand(app), AddOtherPrograms(app)}) {
    commands.insert(commands.end(), added.begin(), added.end());
  }

  auto arguments = ExpandedWords(app, {argv + 1, argv + argc});
  if (!arguments.ok()) return Report(BadInput(arguments.status()));
  if (const auto code = ParseWords(app, *std::move(arguments))) return *code;
  for (const Command& command : commands) {
    if (command.app->parsed()) return RunBody(command.body);
  }
  return kExitBadUsage;
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) {
  b4mrl::RestartWithBetterBlasKernels(argv);
  b4mrl::CatchInterrupts();
  return b4mrl::RunProgram("b4mrl", [=] { return b4mrl::Run(argc, argv); });
}
