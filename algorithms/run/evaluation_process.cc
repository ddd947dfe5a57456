#include "algorithms/run/evaluation_process.h"

#include <fmt/format.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/base/child_program.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxOutputBytes = 1 << 20;  // more than the episodes that a session can have

}  // namespace

// The numbers were printed with all their bits.
Result<EvaluationResult> ParseEvaluation(std::string_view text) {
  const auto json = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  const auto numbers = [](const nlohmann::json& array) {
    for (const auto& item : array) {
      if (!item.is_number()) return false;
    }
    return array.is_array() && !array.empty();
  };
  const bool whole = json.is_object() && numbers(json.value("returns", nlohmann::json())) &&
                     numbers(json.value("lengths", nlohmann::json())) &&
                     json["returns"].size() == json["lengths"].size() &&
                     json.contains("mean_return") && json["mean_return"].is_number() &&
                     json.contains("std_return") && json["std_return"].is_number();
  if (!whole) return Status(StatusCode::kDataLoss, "an evaluation did not print its result");
  EvaluationResult result;
  for (const auto& item : json["returns"]) result.returns.push_back(item.get<double>());
  for (const auto& item : json["lengths"]) result.lengths.push_back(item.get<uint32_t>());
  result.mean_return = json["mean_return"].get<double>();
  result.std_return = json["std_return"].get<double>();
  const auto given_up = json.find("given_up_episodes");
  if (given_up != json.end() && given_up->is_number_unsigned()) {
    result.given_up = given_up->get<uint32_t>();
  }
  const auto score = json.find("score");
  if (score != json.end() && score->is_number()) result.score = score->get<double>();
  return result;
}

Result<EvaluationProcess> EvaluationProcess::Start(const EvaluationRequest& request) {
  ProgramWithOutput started;
  const int error =
      StartWithOutput(request.program,
                      {request.program, "evaluate", "--json", "--endpoint", request.endpoint,
                       "--agent", request.agent_path, "--environment", request.environment,
                       "--episodes", fmt::format("{}", request.episodes)},
                      &started);
  if (error != 0) return IoError("start", request.program, error);
  return EvaluationProcess(started.process_id, std::move(started.output));
}

EvaluationProcess::EvaluationProcess(EvaluationProcess&& other) noexcept
    : process_id_(std::exchange(other.process_id_, 0)),
      output_(std::move(other.output_)),
      text_(std::move(other.text_)),
      deadline_(other.deadline_) {}

EvaluationProcess::~EvaluationProcess() {
  if (process_id_ == 0) return;
  kill(process_id_, SIGKILL);
  WaitForExit(process_id_, Deadline::AfterMs(0));
}

bool EvaluationProcess::ReadSome() {
  std::array<char, 4096> block{};
  const ssize_t length = read(output_.get(), block.data(), block.size());
  if (length < 0) return errno != EINTR;
  text_.append(block.data(), static_cast<size_t>(length));
  return length == 0 || text_.size() > kMaxOutputBytes;
}

bool EvaluationProcess::Ended() {
  while (output_.valid()) {
    pollfd waiting{output_.get(), POLLIN, 0};
    if (poll(&waiting, 1, 0) <= 0) return deadline_.expired();
    if (ReadSome()) output_.Reset();
  }
  return true;
}

Result<EvaluationResult> EvaluationProcess::Wait() {
  while (output_.valid()) {
    const Status ready = WaitUntilReady(output_.get(), POLLIN, deadline_);
    if (ready.ok() ? ReadSome() : deadline_.expired()) output_.Reset();
  }
  const int wait_status = WaitForExit(std::exchange(process_id_, 0), deadline_);
  if (WIFSIGNALED(wait_status)) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the evaluation was ended by signal {}", WTERMSIG(wait_status)));
  }
  if (WEXITSTATUS(wait_status) != 0) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("the evaluation ended with code {}", WEXITSTATUS(wait_status)));
  }
  return ParseEvaluation(text_);
}

}  // namespace b4mrl
