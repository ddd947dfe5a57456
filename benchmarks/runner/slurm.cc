#include "benchmarks/runner/slurm.h"

#include <fmt/format.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <string_view>
#include <system_error>

#include "data/files/csv_lines.h"
#include "data/files/file_hash.h"
#include "proto/base/child_program.h"
#include "proto/command_line/shell_word.h"

namespace b4mrl {
namespace {

namespace fs = std::filesystem;

// Seconds before the time limit at which a task is told to save. Saving takes seconds; Slurm looks
// at time limits every 30 s.
constexpr int kSecondsToSave = 120;
constexpr int64_t kSlurmDeadlineMs = 120'000;  // for answers of a busy controller
constexpr std::string_view kDigits = "0123456789";
constexpr std::string_view kMostTasks = "max_array_tasks=";  // among the scheduler's parameters

// {0}: lines of #SBATCH, {1}: folder in which the command was given, {2}: the task's command, {3}:
// the run's number.
constexpr char kScript[] = R"(#!/bin/bash
{0}
# A task trains the run of plan.json that has the task's number, counted from the first run of this
# script's block. Shortly before the task's time limit (signal USR2) the run is saved and the task
# is queued again. After a node has failed, Slurm itself queues the task again. In both cases the
# run goes on from its last checkpoint.
set -u
cd {1} || exit 1
child= time_is_up=no stops=no
stop() {{
  stops=yes
  [ -z "$child" ] || kill -TERM "$child"
}}
trap 'time_is_up=yes; stop' USR2
trap stop TERM
{2} --index "{3}" &
child=$!
[ $stops = no ] || stop  # the signal came before the child's id was known
while kill -0 "$child" 2>/dev/null; do wait "$child"; done  # a signal ends a wait early
wait "$child"
code=$?
trap - TERM
if [ $time_is_up = yes ] && [ $code -ge 128 ]; then
  # Slurm ends this script, which must not end by itself: the task would count as failed.
  scontrol requeue "${{SLURM_ARRAY_JOB_ID}}_$SLURM_ARRAY_TASK_ID" && sleep 600
fi
exit $code
)";

// What the script and the look at the queue rest on may not be replaced.
Status CheckOption(const std::string& option) {
  // sbatch takes a value behind a space too, and the beginning of a name for the name.
  const std::string_view name = std::string_view(option).substr(0, option.find_first_of("= "));
  for (const std::string_view own :
       {"--job-name", "--array", "--signal", "--requeue", "--no-requeue", "--open-mode", "--wrap",
        "--parsable", "--clusters", "--wait"}) {
    if (name.size() > 2 && own.starts_with(name)) {
      return InvalidArgument("--sbatch-option", option, "an option that b4mrl does not set itself");
    }
  }
  for (const std::string_view own : {"-J", "-a", "-M", "-W"}) {
    if (option.starts_with(own)) {
      return InvalidArgument("--sbatch-option", option, "an option that b4mrl does not set itself");
    }
  }
  return Status();
}

// The folder's path from the root, without links.
Result<std::string> WholePath(const std::string& folder) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(folder, error);
  if (error) return IoError("find", folder, error.value());
  return whole.string();
}

// The variable of sbatch that has precedence over an option in a script: SBATCH_PARTITION for
// "--partition=long".
std::string VariableOf(std::string_view option) {
  option = option.substr(0, option.find_first_of("= "));
  static const std::map<std::string_view, std::string_view> kShort = {
      {"-A", "ACCOUNT"}, {"-C", "CONSTRAINT"}, {"-G", "GPUS"},      {"-e", "ERROR"},
      {"-o", "OUTPUT"},  {"-p", "PARTITION"},  {"-t", "TIMELIMIT"}, {"-q", "QOS"}};
  std::string name = "SBATCH_";
  // A short option may have its value behind it, "-plong".
  if (const auto found = kShort.find(option.substr(0, 2)); found != kShort.end()) {
    return name.append(found->second);
  }
  for (const char c : option.substr(std::min(option.find_first_not_of('-'), option.size()))) {
    name += c == '-' ? '_' : static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  }
  return name;
}

// This process's variables without those that would replace what a script says, or hide tasks of
// the queue.
std::vector<std::string> VariablesForSlurm(const std::vector<std::string>& sbatch_options = {}) {
  std::set<std::string> names = {"SBATCH_JOB_NAME",    "SBATCH_ARRAY_INX",   "SBATCH_TIMELIMIT",
                                 "SBATCH_NO_REQUEUE",  "SBATCH_REQUEUE",     "SBATCH_SIGNAL",
                                 "SBATCH_OPEN_MODE",   "SBATCH_CLUSTERS",    "SBATCH_WAIT",
                                 "SBATCH_OUTPUT",      "SBATCH_MEM_PER_CPU", "SBATCH_MEM_PER_GPU",
                                 "SBATCH_MEM_PER_NODE"};
  for (const std::string& option : sbatch_options) names.insert(VariableOf(option));
  std::vector<std::string> variables = EnvironmentWith({});
  std::erase_if(variables, [&names](const std::string& variable) {
    const std::string name = variable.substr(0, variable.find('='));
    return name.starts_with("SQUEUE_") || names.contains(name);
  });
  return variables;
}

// What a program of Slurm prints. Its messages go to our stderr.
Result<std::string> OutputOf(const std::vector<std::string>& words,
                             std::vector<std::string> variables = VariablesForSlurm()) {
  ProgramWithOutput program;
  const int error = StartWithOutput(words.front(), words, &program, std::move(variables));
  if (error != 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("cannot start Slurm's {}: {}; submit from a machine of the cluster",
                              words.front(), std::strerror(error)));
  }
  const Deadline deadline = Deadline::AfterMs(kSlurmDeadlineMs);
  std::string output;
  std::array<char, 4096> bytes{};
  while (WaitUntilReady(program.output.get(), POLLIN, deadline).ok()) {
    const ssize_t count = read(program.output.get(), bytes.data(), bytes.size());
    if (count <= 0) break;
    output.append(bytes.data(), static_cast<size_t>(count));
  }
  if (WaitForExit(program.process_id, deadline) == 0) return output;
  return Status(StatusCode::kInternal, fmt::format("Slurm's {} failed", words.front()));
}

// "" for the first block, "+1001" for the one that begins with run 1001.
std::string SuffixOf(uint64_t first_run) {
  return first_run == 0 ? "" : fmt::format("+{}", first_run);
}

// The whole number at the beginning of a text, and nothing without one.
std::optional<uint64_t> LeadingNumber(std::string_view text) {
  uint64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() ? std::optional(number) : std::nullopt;
}

}  // namespace

Result<std::string> SlurmJobName(const std::string& folder, uint64_t first_run) {
  B4MRL_ASSIGN_OR_RETURN(const std::string whole, WholePath(folder));
  return "b4mrl-" + Sha256OfText(whole).substr(0, 16) + SuffixOf(first_run);
}

Result<uint64_t> MaxArraySize() {
  B4MRL_ASSIGN_OR_RETURN(const std::string output, OutputOf({"scontrol", "show", "config"}));
  std::optional<uint64_t> size;
  uint64_t most_tasks = std::numeric_limits<uint64_t>::max();
  for (const std::string_view line : LinesOf(output)) {
    if (line.starts_with("MaxArraySize")) {
      size = LeadingNumber(line.substr(std::min(line.find_first_of(kDigits), line.size())));
    }
    const size_t tasks =
        line.starts_with("SchedulerParameters") ? line.find(kMostTasks) : line.npos;
    if (tasks == line.npos) continue;
    most_tasks = LeadingNumber(line.substr(tasks + kMostTasks.size())).value_or(most_tasks);
  }
  if (size && *size > 0) return std::max<uint64_t>(std::min(*size, most_tasks), 1);
  return Status(StatusCode::kDataLoss,
                "scontrol show config must say a whole number above 0 as MaxArraySize");
}

std::vector<RunBlock> BlocksOf(const std::vector<uint64_t>& indices, uint64_t array_size) {
  std::vector<RunBlock> blocks;
  for (const uint64_t index : indices) {
    const uint64_t first_run = index / array_size * array_size;
    if (blocks.empty() || blocks.back().first_run != first_run) blocks.push_back({first_run, {}});
    blocks.back().indices.push_back(index);
  }
  return blocks;
}

std::string ScriptName(const RunBlock& block) {
  return fmt::format("slurm{}.sh", SuffixOf(block.first_run));
}

std::string CompactList(const std::vector<uint64_t>& indices) {
  std::string list;
  for (size_t i = 0; i < indices.size();) {
    size_t last = i;
    while (last + 1 < indices.size() && indices[last + 1] == indices[last] + 1) ++last;
    list += fmt::format("{}{}", list.empty() ? "" : ",", indices[i]);
    if (last > i) list += fmt::format("-{}", indices[last]);
    i = last + 1;
  }
  return list;
}

Result<std::string> BatchScript(const SlurmJob& job, const RunBlock& block) {
  std::error_code error;
  const std::string here = fs::current_path(error).string();
  if (error) return IoError("find", "the working folder", error.value());
  B4MRL_ASSIGN_OR_RETURN(const std::string name, SlurmJobName(job.folder, block.first_run));
  B4MRL_ASSIGN_OR_RETURN(const std::string folder, WholePath(job.folder));
  const std::string logs = folder + "/logs";
  // Slurm gives these characters a meaning of its own, with quotes or without.
  if (logs.find_first_of("%\"\\\n") != std::string::npos) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("--out {}: the path of a folder for Slurm's logs must have no %, \", "
                              "\\ or line break",
                              job.folder));
  }
  std::vector<uint64_t> tasks;
  for (const uint64_t index : block.indices) tasks.push_back(index - block.first_run);
  const std::string suffix = SuffixOf(block.first_run);  // of logs too, whose %a is the task
  const std::string number = block.first_run == 0
                                 ? "$SLURM_ARRAY_TASK_ID"
                                 : fmt::format("$(({} + SLURM_ARRAY_TASK_ID))", block.first_run);
  std::string limit = job.parallel_tasks > 0 ? fmt::format("%{}", job.parallel_tasks) : "";
  std::vector<std::string> options = {"--job-name=" + name,
                                      "--array=" + CompactList(tasks) + limit,
                                      "--time=" + job.time,
                                      "--ntasks=1",
                                      "--cpus-per-task=1",
                                      "--mem=4G",
                                      "--requeue",
                                      "--open-mode=append",
                                      fmt::format("--output=\"{}/%a{}.log\"", logs, suffix),
                                      fmt::format("--signal=B:USR2@{}", kSecondsToSave)};
  for (const std::string& option : job.sbatch_options) {
    B4MRL_RETURN_IF_ERROR(CheckOption(option));
    options.push_back(option);
  }
  std::string lines, command;
  for (const std::string& option : options) {
    if (!option.starts_with('-') || option.find('\n') != std::string::npos) {
      return Status(StatusCode::kInvalidArgument,
                    fmt::format("--sbatch-option {}: must be one line that begins with '-', as in "
                                "--sbatch-option=--partition=long",
                                option));
    }
    lines += "#SBATCH " + option + "\n";
  }
  for (const std::string& word : job.command) {
    command += (command.empty() ? "" : " ") + ShellWord(word);
  }
  return fmt::format(kScript, lines, ShellWord(here), command, number);
}

Result<std::set<uint64_t>> QueuedIndices(const std::string& folder, uint64_t runs,
                                         uint64_t array_size) {
  B4MRL_ASSIGN_OR_RETURN(const std::string name, SlurmJobName(folder));
  std::string names = name;
  for (uint64_t first = array_size; first < runs; first += array_size) {
    names += "," + name + SuffixOf(first);
  }
  B4MRL_ASSIGN_OR_RETURN(const std::string output, OutputOf({"squeue", "--array", "--noheader",
                                                             "--format=%K %j", "--name=" + names}));
  std::set<uint64_t> indices;
  for (const std::string_view line : LinesOf(output)) {
    const auto task = LeadingNumber(line);
    const size_t suffix = line.find('+');
    const auto first = suffix == line.npos ? 0 : LeadingNumber(line.substr(suffix + 1));
    if (task && first) indices.insert(*first + *task);
  }
  return indices;
}

Result<std::string> SubmitScript(const std::string& path,
                                 const std::vector<std::string>& sbatch_options) {
  B4MRL_ASSIGN_OR_RETURN(const std::string output, OutputOf({"sbatch", "--parsable", path},
                                                            VariablesForSlurm(sbatch_options)));
  return output.substr(0, output.find_first_of(";\n"));
}

}  // namespace b4mrl
