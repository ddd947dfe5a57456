// An evaluation beside the training: `b4mrl-tools evaluate` as a child process, on a file that
// nobody may change meanwhile. Its scores have the bits of Evaluator's, which it runs. Thread rule:
// one thread.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>
#include <string_view>

#include "algorithms/episodes/evaluate.h"
#include "proto/base/clock.h"
#include "proto/base/status.h"
#include "proto/base/unique_fd.h"

namespace b4mrl {

// After this an evaluation counts as lost.
inline constexpr int64_t kEvaluationMs = 1'800'000;

// What `b4mrl evaluate --json` printed; kDataLoss.
Result<EvaluationResult> ParseEvaluation(std::string_view json);

struct EvaluationRequest {
  std::string program;  // b4mrl-tools
  std::string endpoint;
  std::string agent_path;
  std::string environment;
  uint32_t episodes = 10;
};

class EvaluationProcess {
 public:
  // kIoError when the program cannot be started.
  static Result<EvaluationProcess> Start(const EvaluationRequest& request);
  EvaluationProcess(EvaluationProcess&& other) noexcept;
  EvaluationProcess& operator=(EvaluationProcess&& other) = delete;
  ~EvaluationProcess();  // ends it

  // Whether Wait would return without waiting.
  bool Ended();
  // kFailedPrecondition when it failed, after its own message on stderr; kDeadlineExceeded.
  Result<EvaluationResult> Wait();

 private:
  EvaluationProcess(pid_t process_id, UniqueFd output)
      : process_id_(process_id), output_(std::move(output)) {}
  // Takes what there is to read now; true at the end of the output.
  bool ReadSome();

  pid_t process_id_;  // 0: none any more
  UniqueFd output_;
  std::string text_;
  Deadline deadline_ = Deadline::AfterMs(kEvaluationMs);
};

}  // namespace b4mrl
