// The batch script of a suite, run by a shell as Slurm's daemons run it.
#include "benchmarks/runner/slurm.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <string>
#include <vector>

#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

// A folder with a script, and an `scontrol` that notes what it was told and ends the script, as
// Slurm does.
class Task {
 public:
  explicit Task(const std::vector<std::string>& command) {
    const SlurmJob job = {.folder = folder_.path(), .command = command};
    WriteBytes(folder_.File("script"), Take(BatchScript(job, {7})));
    WriteBytes(folder_.File("scontrol"),
               fmt::format("#!/bin/sh\necho $@ >{}\nkill -KILL $PPID\n", folder_.File("told")));
    Shell("chmod +x " + folder_.File("scontrol"));
  }
  // Runs the script to its end. The exit code, 128 + its number if a signal has ended the script.
  int Run() {
    return Shell(
        fmt::format("PATH={}:$PATH SLURM_ARRAY_JOB_ID=12 SLURM_ARRAY_TASK_ID=7 bash {} >{}",
                    folder_.path(), folder_.File("script"), folder_.File("out")));
  }
  std::string printed() const { return ReadBytes(folder_.File("out")); }
  // What scontrol was told; "" if it was not called.
  std::string told() const {
    return std::filesystem::exists(folder_.File("told")) ? ReadBytes(folder_.File("told")) : "";
  }

 private:
  static int Shell(const std::string& command) {
    return WEXITSTATUS(std::system(command.c_str()));  // NOLINT
  }
  TemporaryFolder folder_;
};

TEST_CASE("Numbers of runs become a list of ranges") {
  CHECK(CompactList({}).empty());
  CHECK(CompactList({5}) == "5");
  CHECK(CompactList({0, 1, 2, 3}) == "0-3");
  CHECK(CompactList({0, 2, 3, 7, 9, 10, 11}) == "0,2-3,7,9-11");
}

TEST_CASE("A task's command reaches the program word by word, with the number of its run") {
  Task task({"printf", "%s|", "a b", "it's", "*", "", "$HOME"});
  CHECK(task.Run() == 0);
  CHECK(task.printed() == "a b|it's|*||$HOME|--index|7|");
  CHECK(task.told().empty());
}

TEST_CASE("A task that is told of its time limit stops its run and is queued again") {
  // Signals the script as Slurm does, and ends like a runner that is told to stop.
  Task task({"sh", "-c", "trap 'exit 143' TERM; kill -USR2 $PPID; while :; do sleep 0.01; done"});
  CHECK(task.Run() == 137);
  CHECK(task.told() == "requeue 12_7\n");
}

TEST_CASE("A task whose run ends in spite of the time limit is not queued again") {
  Task done({"sh", "-c", "trap 'exit 0' TERM; kill -USR2 $PPID; while :; do sleep 0.01; done"});
  CHECK(done.Run() == 0);
  CHECK(done.told().empty());
  Task failed({"sh", "-c", "exit 1"});
  CHECK(failed.Run() == 1);
  CHECK(failed.told().empty());
}

TEST_CASE("A task that is told to end stops its run and is not queued again") {
  Task task({"sh", "-c", "trap 'exit 143' TERM; kill -TERM $PPID; while :; do sleep 0.01; done"});
  CHECK(task.Run() == 143);
  CHECK(task.told().empty());
}

TEST_CASE("What cannot stand in a batch script is refused") {
  SlurmJob job = {.folder = "a%b"};
  CHECK(BatchScript(job, {0}).status().code() == StatusCode::kInvalidArgument);
  job.folder = "suite";
  for (const char* option : {"partition=long", "", "--comment=a\nrm -r x"}) {
    CAPTURE(option);
    job.sbatch_options = {option};
    CHECK(BatchScript(job, {0}).status().code() == StatusCode::kInvalidArgument);
  }
  job.sbatch_options = {"--partition=long", "-A lab"};
  job.parallel_tasks = 3;
  const std::string script = Take(BatchScript(job, {0, 1, 5}));
  CHECK(script.find("#SBATCH --array=0-1,5%3\n") != std::string::npos);
  CHECK(script.find("#SBATCH --partition=long\n#SBATCH -A lab\n") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
