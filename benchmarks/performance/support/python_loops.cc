#include "benchmarks/performance/support/python_loops.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/socket.h>

#include <cstdlib>
#include <cstring>
#include <span>
#include <sstream>
#include <string_view>
#include <utility>

#include "proto/base/child_program.h"
#include "proto/base/clock.h"
#include "proto/base/folders.h"

namespace b4mrl::perf {
namespace {

constexpr double kStartSeconds = 120;  // Python reads its packages, peers make their environments
constexpr int64_t kExitMs = 5'000;
constexpr size_t kMaxLineBytes = 4096;

Status Unavailable(const std::string& message) { return Status(StatusCode::kUnavailable, message); }

}  // namespace

Result<std::unique_ptr<PythonLoops>> PythonLoops::Start(const std::string& endpoint) {
  const std::string script =
      SharedFolder("performance", B4MRL_PERFORMANCE_FOLDER) + "/python_rates.py";
  ProgramOnSocket program;
  if (const int error = StartOnSocket("python3", {"python3", script, endpoint}, &program);
      error != 0) {
    return Unavailable(fmt::format("python3 cannot be started: {}", std::strerror(error)));
  }
  std::unique_ptr<PythonLoops> loops(
      new PythonLoops(program.process_id, std::move(program.socket)));
  B4MRL_ASSIGN_OR_RETURN(const std::string line, loops->ReadLine(kStartSeconds));
  std::istringstream words(line);
  for (std::string name; words >> name;) loops->names_.insert(name);
  return loops;
}

PythonLoops::~PythonLoops() {
  socket_.Reset();  // Python ends with it
  WaitForExit(process_id_, Deadline::AfterMs(kExitMs));
}

Result<double> PythonLoops::Rate(const std::string& name, double seconds) {
  const std::string asked = fmt::format("{} {}\n", name, seconds);
  B4MRL_RETURN_IF_ERROR(SendAll(socket_.get(), std::as_bytes(std::span(asked)),
                                Deadline::AfterMs(static_cast<int64_t>(kStartSeconds * 1000))));
  B4MRL_ASSIGN_OR_RETURN(const std::string line, ReadLine(kStartSeconds + 2 * seconds));
  return std::strtod(line.c_str(), nullptr);
}

Result<std::string> PythonLoops::ReadLine(double seconds) {
  const Deadline deadline = Deadline::AfterMs(static_cast<int64_t>(seconds * 1000));
  std::string line;
  char byte = 0;
  while (line.size() < kMaxLineBytes) {
    B4MRL_RETURN_IF_ERROR(WaitUntilReady(socket_.get(), POLLIN, deadline));
    if (recv(socket_.get(), &byte, 1, 0) != 1) return Unavailable("python3 ended early");
    if (byte == '\n') break;
    line += byte;
  }
  constexpr std::string_view kFailed = "failed ";
  if (line.starts_with(kFailed)) return Unavailable(line.substr(kFailed.size()));
  return line;
}

}  // namespace b4mrl::perf
