// The batch script of a suite, run by a shell as Slurm's daemons run it.
#include "benchmarks/runner/slurm.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <set>
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
  explicit Task(const std::vector<std::string>& command, uint64_t first_run = 0) {
    const SlurmJob job = {.folder = folder_.path(), .command = command};
    WriteBytes(folder_.File("script"), Take(BatchScript(job, {first_run, {first_run + 7}})));
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

TEST_CASE("Runs with greater numbers than an array may have become blocks that count anew") {
  const auto blocks = BlocksOf({0, 999, 1001, 2002, 2399}, 1001);
  REQUIRE(blocks.size() == 3);
  CHECK(blocks[0].indices == std::vector<uint64_t>{0, 999});
  CHECK(ScriptName(blocks[0]) == "slurm.sh");
  CHECK(blocks[1].first_run == 1001);
  CHECK(ScriptName(blocks[1]) == "slurm+1001.sh");
  CHECK(BlocksOf({5}, 5).front().first_run == 5);
  CHECK(BlocksOf({}, 5).empty());
  const std::string script = Take(BatchScript({.folder = "suite"}, blocks[2]));
  CHECK(script.find("#SBATCH --array=0,397\n") != std::string::npos);
  CHECK(script.find("/logs/%a+2002.log\"\n") != std::string::npos);
  CHECK(script.find("--job-name=" + Take(SlurmJobName("suite")) + "+2002\n") != std::string::npos);
  Task task({"printf", "%s|"}, 2002);
  CHECK(task.Run() == 0);
  CHECK(task.printed() == "--index|2009|");
}

TEST_CASE("The queue and the array size are asked of Slurm's programs") {
  const TemporaryFolder folder;
  const auto programs = [&](const std::string& scontrol, const std::string& squeue) {
    WriteBytes(folder.File("scontrol"), "#!/bin/sh\n" + scontrol + "\n");
    WriteBytes(folder.File("squeue"), "#!/bin/sh\n" + squeue + "\n");
    for (const char* name : {"scontrol", "squeue"}) {
      std::filesystem::permissions(folder.File(name), std::filesystem::perms::owner_all);
    }
  };
  const std::string path = std::getenv("PATH");
  setenv("PATH", (folder.path() + ":" + path).c_str(), 1);
  programs("echo 'MaxArraySize            = 1001'",
           "echo \"$@\" >" + folder.File("told") + "; echo '3 x'; echo '3 x+500'; echo 'N/A x'");
  CHECK(Take(MaxArraySize()) == 1001);
  CHECK(Take(QueuedIndices(folder.path(), 1001, 500)) == std::set<uint64_t>{3, 503});
  const std::string name = Take(SlurmJobName(folder.path()));
  CHECK(ReadBytes(folder.File("told")) == "--array --noheader --format=%K %j --name=" + name + "," +
                                              name + "+500," + name + "+1000\n");
  programs("echo 'MaxArraySize = 1001'; echo 'SchedulerParameters = x=1,max_array_tasks=100,y=2'",
           "echo \"${SQUEUE_PARTITION-unset}\" >" + folder.File("told"));
  CHECK(Take(MaxArraySize()) == 100);
  setenv("SQUEUE_PARTITION", "other", 1);
  CHECK(Take(QueuedIndices(folder.path(), 1, 500)).empty());
  CHECK(ReadBytes(folder.File("told")) == "unset\n");
  unsetenv("SQUEUE_PARTITION");
  programs("echo 'MaxArraySize = none'", "exit 1");
  CHECK(MaxArraySize().status().code() == StatusCode::kDataLoss);
  CHECK(QueuedIndices(folder.path(), 1, 500).status().code() == StatusCode::kInternal);
  setenv("PATH", path.c_str(), 1);
}

TEST_CASE("Variables that sbatch prefers to the script's own options do not reach it") {
  const TemporaryFolder folder;
  WriteBytes(folder.File("sbatch"), "#!/bin/sh\nenv | grep SBATCH_ | sort >" + folder.File("told") +
                                        "\necho '12;cluster'\n");
  std::filesystem::permissions(folder.File("sbatch"), std::filesystem::perms::owner_all);
  const std::vector<std::string> names = {"SBATCH_ACCOUNT", "SBATCH_PARTITION", "SBATCH_TIMELIMIT"};
  for (const std::string& name : names) setenv(name.c_str(), "mine", 1);
  const std::string path = std::getenv("PATH");
  setenv("PATH", (folder.path() + ":" + path).c_str(), 1);
  CHECK(Take(SubmitScript("slurm.sh", {})) == "12");
  CHECK(ReadBytes(folder.File("told")) == "SBATCH_ACCOUNT=mine\nSBATCH_PARTITION=mine\n");
  for (const char* option : {"--partition=long", "--partition long", "-p long", "-plong"}) {
    CAPTURE(option);
    CHECK(Take(SubmitScript("slurm.sh", {option})) == "12");
    CHECK(ReadBytes(folder.File("told")) == "SBATCH_ACCOUNT=mine\n");
  }
  setenv("PATH", path.c_str(), 1);
  for (const std::string& name : names) unsetenv(name.c_str());
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
  CHECK(BatchScript(job, {0, {0}}).status().code() == StatusCode::kInvalidArgument);
  job.folder = "suite";
  for (const char* option :
       {"partition=long", "", "--comment=a\nrm -r x", "--job-name=mine", "-J x", "--array=0-9",
        "-a1", "--no-requeue", "--signal=TERM@9", "--clusters=c2", "-M c2", "--job-name mine",
        "--arr=0-9", "--wait", "-W"}) {
    CAPTURE(option);
    job.sbatch_options = {option};
    CHECK(BatchScript(job, {0, {0}}).status().code() == StatusCode::kInvalidArgument);
  }
  job.sbatch_options = {"--partition=long", "-A lab"};
  job.parallel_tasks = 3;
  const std::string script = Take(BatchScript(job, {0, {0, 1, 5}}));
  CHECK(script.find("#SBATCH --array=0-1,5%3\n") != std::string::npos);
  CHECK(script.find("#SBATCH --partition=long\n#SBATCH -A lab\n") != std::string::npos);
}

}  // namespace
}  // namespace b4mrl
