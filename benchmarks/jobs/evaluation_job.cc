#include "benchmarks/jobs/evaluation_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>
#include <vector>

#include "benchmarks/records/json_file.h"
#include "data/files/atomic_file.h"

namespace b4mrl {
namespace {

constexpr size_t kMaxOutput = 64 << 20;  // bytes that an evaluation may print

}  // namespace

std::string LogOfEvaluation(const std::string& result) { return result + ".log"; }

Result<Job> StartEvaluation(const EvaluationOrder& order, const std::string& result,
                            UniqueFd claim) {
  std::error_code ignored;
  std::filesystem::remove(LogOfEvaluation(result), ignored);  // of an earlier attempt
  std::vector<std::string> words = {"evaluate",      "--json",
                                    "--agent",       order.agent,
                                    "--environment", order.environment,
                                    "--observe",     order.observe,
                                    "--episodes",    fmt::format("{}", order.episodes),
                                    "--seed",        fmt::format("{}", order.seed)};
  words.insert(words.end(), order.daemon_words.begin(), order.daemon_words.end());
  if (!order.simulator.empty()) words.insert(words.end(), {"--simulator", order.simulator});
  return Job::Start(ToolOrder(std::move(words), LogOfEvaluation(result)), std::move(claim));
}

Status KeepEvaluation(const std::string& result) {
  B4MRL_ASSIGN_OR_RETURN(std::string text, ReadSmallFile(LogOfEvaluation(result), kMaxOutput));
  // The JSON is a line of its own among those in which the command and its daemon say something.
  const size_t behind = text.rfind("\n{");
  if (behind != std::string::npos) text.erase(0, behind + 1);
  text.erase(std::min(text.find('\n'), text.size()));
  B4MRL_ASSIGN_OR_RETURN(const auto printed, ParseJsonObject(text, LogOfEvaluation(result)));
  if (!NumbersOf(printed, "returns")) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} holds no returns that are numbers", LogOfEvaluation(result)));
  }
  B4MRL_RETURN_IF_ERROR(WriteSmallFile(result, text + "\n"));
  std::error_code ignored;
  std::filesystem::remove(LogOfEvaluation(result), ignored);
  return Status();
}

}  // namespace b4mrl
