// `b4mrl`: one name for five programs that stand beside it.
//
//   b4mrl serve ...     -> b4mrl-serve ...      the daemon
//   b4mrl perf ...      -> b4mrl-perf ...       measurements
//   b4mrl benchmark ... -> b4mrl-benchmark ...  trains the runs of suites
//   b4mrl report ...    -> b4mrl-report ...     makes tables and figures of their results
//   b4mrl <other> ...   -> b4mrl-tools <other> ...
//   b4mrl help ...      -> b4mrl ... --help
// The launcher replaces itself by the program, so signals, exit code and process id are the
// program's own, and a learner's process never holds the simulator. B4MRL_SERVER, B4MRL_PERF,
// B4MRL_RUNNER, B4MRL_REPORT and B4MRL_TOOLS name another file to run. Links nothing of the
// project.
//
// Every program but the daemon holds learners, which are compiled for one kind of processor. On
// another one it would end by SIGILL, perhaps before its main function, so the launcher, which runs
// on every x86-64 processor, looks first.
#include <needed_features.h>  // B4MRL_NEEDED_FEATURES and B4MRL_ARCHITECTURE, which CMake writes
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <iterator>
#include <string>
#include <string_view>

namespace {

constexpr int kExitCannotStart = 127;  // as a shell reports a missing command

// Commands with a program of their own.
struct Program {
  std::string_view command;
  const char* variable;
  std::string_view file;
};
constexpr Program kPrograms[] = {{"serve", "B4MRL_SERVER", "b4mrl-serve"},
                                 {"perf", "B4MRL_PERF", "b4mrl-perf"},
                                 {"benchmark", "B4MRL_RUNNER", "b4mrl-benchmark"},
                                 {"report", "B4MRL_REPORT", "b4mrl-report"}};

std::string OwnFolder() {
  std::array<char, PATH_MAX> buffer{};
  const ssize_t length = readlink("/proc/self/exe", buffer.data(), buffer.size());
  if (length <= 0) return ".";
  const std::string path(buffer.data(), static_cast<size_t>(length));
  return path.substr(0, path.rfind('/'));
}

std::string ProgramPath(const char* variable, std::string_view name) {
  const char* override_path = std::getenv(variable);
  if (override_path == nullptr || *override_path == '\0') {
    return OwnFolder() + "/" + std::string(name);
  }
  const std::string path = override_path;
  std::array<char, PATH_MAX> launcher{};  // perhaps by a link, it stands for what is beside it
  const bool is_launcher = path.substr(path.rfind('/') + 1) == "b4mrl" &&
                           realpath(override_path, launcher.data()) != nullptr;
  if (!is_launcher) return path;
  const std::string_view found = launcher.data();
  return std::string(found.substr(0, found.rfind('/') + 1)) + std::string(name);
}

// An instruction set that the learners need and this processor lacks; nullptr if it lacks none.
const char* MissingFeature() {
  __builtin_cpu_init();
#define B4MRL_FEATURE(name) \
  if (!__builtin_cpu_supports(name)) return name;
  B4MRL_NEEDED_FEATURES
#undef B4MRL_FEATURE
  return nullptr;
}

}  // namespace

int main(int argc, char** argv) {
  std::string help = "--help";
  if (argc > 1 && std::string_view(argv[1]) == "help") {
    std::copy(argv + 2, argv + argc, argv + 1);
    argv[argc - 1] = help.data();
  }
  const std::string_view command = argc > 1 ? argv[1] : "--help";
  const auto* const own = std::find_if(std::begin(kPrograms), std::end(kPrograms),
                                       [&](const Program& p) { return p.command == command; });
  const bool own_program = own != std::end(kPrograms);
  const char* const missing = command == "serve" ? nullptr : MissingFeature();
  if (missing != nullptr) {
    std::fprintf(stderr,
                 "b4mrl: this processor lacks %s, and the learners were compiled for %s; configure "
                 "the build with -DB4MRL_ARCH=x86-64-v3, for processors of several kinds, or build "
                 "on this machine\n",
                 missing, B4MRL_ARCHITECTURE);
    return kExitCannotStart;
  }
  std::string path = own_program ? ProgramPath(own->variable, own->file)
                                 : ProgramPath("B4MRL_TOOLS", "b4mrl-tools");
  // argv[0] stays the program's path; programs of their own do not get the command's word.
  char** arguments = own_program ? argv + 1 : argv;
  arguments[0] = path.data();
  execv(path.c_str(), arguments);
  std::fprintf(stderr, "b4mrl: cannot start %s: %s%s\n", path.c_str(), std::strerror(errno),
               errno == ENOENT ? "; the full build makes all programs (README.md), and variables "
                                 "may name others"
                               : "");
  return kExitCannotStart;
}
