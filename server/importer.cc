#include "server/importer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <vector>

#include "data/atomic_file.h"
#include "data/column_cache.h"
#include "data/file_hash.h"
#include "server/import_dataset.h"
#include "server/sandbox.h"

extern char** environ;

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kMemoryBytes = 2ull << 30;
constexpr uint64_t kMaxDescriptors = 64;
constexpr uint64_t kMinCpuSeconds = 60;
constexpr uint64_t kFileBytesPerCpuSecond = 4ull << 20;
// A compressed file unpacks to at most so many times its size before it counts as an attack.
constexpr uint64_t kMaxExpansion = 64;
constexpr uint64_t kMinFileBytes = 1ull << 30;
constexpr size_t kMaxAnswerBytes = 64 * 1024;
constexpr int64_t kPollMs = 100;

// True when nobody wrote to or replaced the file since `before`.
bool Unchanged(const struct stat& before, const struct stat& after) {
  return before.st_dev == after.st_dev && before.st_ino == after.st_ino &&
         before.st_size == after.st_size && before.st_mtim.tv_sec == after.st_mtim.tv_sec &&
         before.st_mtim.tv_nsec == after.st_mtim.tv_nsec;
}

Result<ImportResult> ImportInSandbox(const ImporterOptions& options) {
  const UniqueFd fd(open(options.file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) return IoError("open", options.file, errno);
  struct stat before {};
  if (fstat(fd.get(), &before) != 0) return IoError("inspect", options.file, errno);
  if (!S_ISREG(before.st_mode)) return InvalidArgument("file", options.file, "a regular file");
  // Hashing parses nothing, so it may come before the sandbox.
  B4MRL_ASSIGN_OR_RETURN(const std::string sha256, Sha256OfDescriptor(fd.get(), options.file));
  const auto file_bytes = static_cast<uint64_t>(before.st_size);
  SandboxOptions sandbox;
  sandbox.readable_file = options.file;
  sandbox.writable_folder = options.cache_folder;
  sandbox.memory_bytes = kMemoryBytes;
  sandbox.cpu_seconds = kMinCpuSeconds + file_bytes / kFileBytesPerCpuSecond;
  sandbox.file_bytes = std::max(kMinFileBytes, file_bytes * kMaxExpansion);
  sandbox.descriptors = kMaxDescriptors;
  B4MRL_RETURN_IF_ERROR(EnterSandbox(sandbox));
  B4MRL_ASSIGN_OR_RETURN(ImportResult result, ImportDataset(options, sha256));
  struct stat after {};
  if (stat(options.file.c_str(), &after) != 0 || !Unchanged(before, after)) {
    RemoveCache(fmt::format("{}/{}", options.cache_folder, result.fingerprint));
    return Status(StatusCode::kUnavailable, "the file changed while it was imported; try again");
  }
  return result;
}

std::string Answer(const Result<ImportResult>& result) {
  Json answer;
  answer["ok"] = result.ok();
  if (result.ok()) {
    answer["fingerprint"] = result->fingerprint;
    answer["sha256"] = result->sha256;
    answer["rows"] = result->rows;
  } else {
    answer["code"] = static_cast<int>(result.status().code());
    answer["message"] = result.status().message();
  }
  return answer.dump(-1, ' ', false, Json::error_handler_t::replace);
}

bool IsFingerprint(const std::string& text) {
  return text.size() == 32 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

Result<ImportResult> ParseAnswer(const std::string& text) {
  const Status malformed(StatusCode::kDataLoss, "the importer gave no usable answer");
  const Json answer = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!answer.is_object() || !answer.contains("ok") || !answer["ok"].is_boolean()) return malformed;
  const Json code = answer.value("code", Json());
  const Json message = answer.value("message", Json());
  if (!answer["ok"].get<bool>()) {
    if (!code.is_number_integer() || !message.is_string()) return malformed;
    const int number = code.get<int>();
    const bool known = number > 0 && StatusCodeName(static_cast<StatusCode>(number)) != "UNKNOWN";
    return Status(known ? static_cast<StatusCode>(number) : StatusCode::kInternal,
                  message.get<std::string>());
  }
  const Json fingerprint = answer.value("fingerprint", Json());
  const Json sha256 = answer.value("sha256", Json());
  const Json rows = answer.value("rows", Json());
  if (!fingerprint.is_string() || !sha256.is_string() || !rows.is_number_unsigned()) {
    return malformed;
  }
  ImportResult result{fingerprint.get<std::string>(), sha256.get<std::string>(),
                      rows.get<uint64_t>()};
  if (!IsFingerprint(result.fingerprint)) return malformed;
  return result;
}

struct Child {
  pid_t id = -1;
  UniqueFd output;
};

// stdin is /dev/null, stdout a pipe, stderr ours; nothing else is passed on.
Result<Child> Spawn(const std::string& program, const ImporterOptions& options) {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return IoError("make a pipe for", program, errno);
  Child child;
  child.output = UniqueFd(ends[0]);
  const UniqueFd input(ends[1]);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, input.get(), STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  const std::vector<std::string> arguments = {
      "b4mrl-serve", "--role", "importer", "--file", options.file, "--cache", options.cache_folder};
  std::vector<char*> argv;
  for (const std::string& argument : arguments) argv.push_back(const_cast<char*>(argument.c_str()));
  argv.push_back(nullptr);
  const int error =
      posix_spawn(&child.id, program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return IoError("start", program, error);
  return child;
}

// Everything up to the end of output; false when the deadline, the size limit or `cancelled` comes
// first.
bool ReadUntilEnd(int fd, const Deadline& deadline, const std::atomic<bool>* cancelled,
                  std::string* text) {
  std::array<char, 4096> block;
  while (text->size() <= kMaxAnswerBytes && !deadline.expired() &&
         (cancelled == nullptr || !cancelled->load(std::memory_order_relaxed))) {
    pollfd waiting{fd, POLLIN, 0};
    const auto wait_ms = static_cast<int>(std::min(deadline.remaining_ms(), kPollMs));
    if (poll(&waiting, 1, wait_ms) <= 0) continue;
    const ssize_t got = read(fd, block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return true;
    text->append(block.data(), static_cast<size_t>(got));
  }
  return false;
}

// Waits for the exit, and enforces it at the deadline. Returns what waitpid reports.
int WaitForExit(pid_t id, const Deadline& deadline) {
  const UniqueFd handle(static_cast<int>(syscall(SYS_pidfd_open, id, 0)));
  while (!deadline.expired()) {
    pollfd waiting{handle.get(), POLLIN, 0};
    const auto wait_ms = static_cast<int>(std::min(deadline.remaining_ms(), kPollMs));
    if (poll(&waiting, 1, wait_ms) > 0) break;
  }
  if (deadline.expired()) kill(id, SIGKILL);
  int exit_status = 0;
  while (waitpid(id, &exit_status, 0) < 0 && errno == EINTR) {
  }
  return exit_status;
}

// What a child that did not end well has left behind.
void RemoveUnfinished(const std::string& cache_folder, pid_t id) {
  RemoveCache(fmt::format("{}/{}{}-0", cache_folder, kUnfinishedCachePrefix, id));
}

}  // namespace

int RunImporter(const ImporterOptions& options) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const Result<ImportResult> result = ImportInSandbox(options);
  std::printf("%s\n", Answer(result).c_str());
  std::fflush(stdout);
  if (result.ok()) return 0;
  return result.status().code() == StatusCode::kInternal ? 1 : 3;
}

Result<ImportResult> ImportInChild(const std::string& program, const ImporterOptions& options,
                                   const Deadline& deadline, const std::atomic<bool>* cancelled) {
  B4MRL_ASSIGN_OR_RETURN(Child child, Spawn(program, options));
  std::string text;
  const bool answered = ReadUntilEnd(child.output.get(), deadline, cancelled, &text);
  if (!answered) kill(child.id, SIGKILL);
  const int exit_status = WaitForExit(child.id, deadline);
  if (exit_status != 0) RemoveUnfinished(options.cache_folder, child.id);
  if (!answered) {
    return Status(StatusCode::kDeadlineExceeded,
                  fmt::format("{} could not be imported in time", options.file));
  }
  if (WIFSIGNALED(exit_status)) {
    return Status(
        StatusCode::kDataLoss,
        fmt::format("{} is damaged: reading it ended the importer by signal {} ({})", options.file,
                    WTERMSIG(exit_status), strsignal(WTERMSIG(exit_status))));
  }
  Result<ImportResult> result = ParseAnswer(text);
  if (!result.ok()) return result.status().WithContext(options.file);
  return result;
}

}  // namespace b4mrl
