#include "server/sandbox/sandboxed_child.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>

#include "proto/base/child_program.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxAnswerBytes = 64 * 1024;
constexpr int64_t kPollMs = 100;
// After this time the child runs at lower priority.
constexpr int64_t kEagerMs = 2000;
constexpr int kPatientNice = 10;
constexpr int64_t kExitMs = 2000;

// The child's whole output, or the reason to end the child before the end of its output.
Status ReadUntilEnd(const SandboxedChild& child, const ProgramWithOutput& process,
                    const Deadline& deadline, const std::atomic<bool>* cancelled,
                    std::string* text) {
  std::array<char, 4096> block;
  const int fd = process.output.get();
  const Deadline eager = Deadline::AfterMs(kEagerMs);
  while (true) {
    if (eager.expired()) setpriority(PRIO_PROCESS, process.process_id, kPatientNice);
    if (text->size() > kMaxAnswerBytes) {
      return Status(StatusCode::kDataLoss, child.name + " answered more than it may");
    }
    if (deadline.expired()) {
      return Status(StatusCode::kDeadlineExceeded, child.name + " did not end in time");
    }
    if (cancelled != nullptr && cancelled->load(std::memory_order_relaxed)) {
      return Status(StatusCode::kUnavailable, child.name + " was cancelled; ask again");
    }
    pollfd waiting{fd, POLLIN, 0};
    const auto wait_ms = static_cast<int>(std::min(deadline.remaining_ms(), kPollMs));
    if (poll(&waiting, 1, wait_ms) <= 0) continue;
    const ssize_t got = read(fd, block.data(), block.size());
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return Status();
    text->append(block.data(), static_cast<size_t>(got));
  }
}

Result<std::string> ParseAnswer(const std::string& text, const std::string& name) {
  const Status malformed(StatusCode::kDataLoss, name + " gave no usable answer");
  const Json answer = ParseShallow<Json>(text, kMaxAnswerDepth);
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
  std::vector<std::string> words = {"b4mrl-serve"};
  words.insert(words.end(), wanted.arguments.begin(), wanted.arguments.end());
  ProgramWithOutput child;
  const int error = StartWithOutput(wanted.program, std::move(words), &child);
  if (error != 0) return {false, IoError("start", wanted.program, error)};
  std::string text;
  const Status answered = ReadUntilEnd(wanted, child, deadline, cancelled, &text);
  if (!answered.ok()) kill(-child.process_id, SIGKILL);  // it leads a group of its own
  // Who has closed its output has nothing left to do.
  const int exit_status =
      WaitForExit(child.process_id, Deadline::AfterMs(std::min(deadline.remaining_ms(), kExitMs)));
  const auto result = [&](Result<std::string> json) {
    return ChildAnswer{exit_status == 0, std::move(json)};
  };
  if (!answered.ok()) return result(answered);
  if (WIFSIGNALED(exit_status)) {
    const int signal = WTERMSIG(exit_status);
    const char* reason = signal == SIGXCPU ? "out of processor time" : strsignal(signal);
    // The kernel kills a process when memory is short, for which the file need not be to blame.
    const StatusCode code = signal == SIGKILL ? StatusCode::kInternal : StatusCode::kDataLoss;
    return result(
        Status(code, fmt::format("it ended {} by signal {} ({})", wanted.name, signal, reason)));
  }
  return result(ParseAnswer(text, wanted.name));
}

void DieWithParent() {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  // The parent may have died before: then nobody reads the answer any more.
  pollfd answer{STDOUT_FILENO, 0, 0};
  if (poll(&answer, 1, 0) > 0 && (answer.revents & POLLERR) != 0) _exit(1);
}

std::string ErrorAnswer(const Status& error) {
  Json answer;
  answer["ok"] = false;
  answer["code"] = static_cast<int>(error.code());
  answer["message"] = error.message();
  return answer.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace b4mrl
