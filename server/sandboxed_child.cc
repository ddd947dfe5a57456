#include "server/sandboxed_child.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>

#include "proto/base/child_program.h"

extern char** environ;

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxAnswerBytes = 64 * 1024;
constexpr int64_t kPollMs = 100;

struct Child {
  pid_t id = -1;
  UniqueFd output;
};

// stdin is /dev/null, stdout a pipe, stderr ours; nothing else is passed on.
Result<Child> Spawn(const SandboxedChild& wanted) {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) return IoError("make a pipe for", wanted.program, errno);
  Child child;
  child.output = UniqueFd(ends[0]);
  const UniqueFd input(ends[1]);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, input.get(), STDOUT_FILENO);
  posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  std::vector<std::string> arguments = {"b4mrl-serve"};
  arguments.insert(arguments.end(), wanted.arguments.begin(), wanted.arguments.end());
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const int error =
      posix_spawn(&child.id, wanted.program.c_str(), &actions, nullptr, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  if (error != 0) return IoError("start", wanted.program, error);
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

Result<std::string> ParseAnswer(const std::string& text, const std::string& name) {
  const Status malformed(StatusCode::kDataLoss, name + " gave no usable answer");
  const Json answer = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!answer.is_object() || !answer.contains("ok") || !answer["ok"].is_boolean()) return malformed;
  if (answer["ok"].get<bool>()) return text;
  const Json code = answer.value("code", Json());
  const Json message = answer.value("message", Json());
  if (!code.is_number_integer() || !message.is_string()) return malformed;
  const int number = code.get<int>();
  const bool known = number > 0 && StatusCodeName(static_cast<StatusCode>(number)) != "UNKNOWN";
  return Status(known ? static_cast<StatusCode>(number) : StatusCode::kInternal,
                message.get<std::string>());
}

}  // namespace

ChildAnswer RunSandboxedChild(const SandboxedChild& wanted, const Deadline& deadline,
                              const std::atomic<bool>* cancelled) {
  Result<Child> child = Spawn(wanted);
  if (!child.ok()) return {-1, false, child.status()};
  std::string text;
  const bool answered = ReadUntilEnd(child->output.get(), deadline, cancelled, &text);
  if (!answered) kill(child->id, SIGKILL);
  const int exit_status = WaitForExit(child->id, deadline);
  const auto result = [&](Result<std::string> json) {
    return ChildAnswer{child->id, exit_status == 0, std::move(json)};
  };
  if (!answered) {
    return result(
        Status(StatusCode::kDeadlineExceeded, fmt::format("{} did not end in time", wanted.name)));
  }
  if (WIFSIGNALED(exit_status)) {
    const int signal = WTERMSIG(exit_status);
    const char* reason = signal == SIGXCPU ? "out of processor time" : strsignal(signal);
    return result(Status(StatusCode::kDataLoss, fmt::format("it ended {} by signal {} ({})",
                                                            wanted.name, signal, reason)));
  }
  return result(ParseAnswer(text, wanted.name));
}

std::string ErrorAnswer(const Status& error) {
  Json answer;
  answer["ok"] = false;
  answer["code"] = static_cast<int>(error.code());
  answer["message"] = error.message();
  return answer.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace b4mrl
