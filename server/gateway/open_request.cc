#include "server/gateway/open_request.h"

#include <fmt/format.h>
#include <sys/random.h>

#include "proto/base/limits.h"

namespace b4mrl {

Status CompleteOpen(const std::string& token, pb::OpenRequest* open) {
  if (token.size() != limits::kTokenBytes) {
    return InvalidNumber("length of session_token", static_cast<double>(token.size()),
                         std::to_string(limits::kTokenBytes));
  }
  if (open->ByteSizeLong() > limits::kMaxOpenRequestBytes) {
    return InvalidNumber("bytes of the Open request", static_cast<double>(open->ByteSizeLong()),
                         fmt::format("at most {}", limits::kMaxOpenRequestBytes));
  }
  if (open->num_envs() > limits::kMaxLanesPerSession) {
    return InvalidNumber("num_envs", open->num_envs(),
                         fmt::format("0..{}", limits::kMaxLanesPerSession));
  }
  if (!pb::AutoresetMode_IsValid(open->autoreset_mode())) {
    return InvalidNumber("autoreset_mode", open->autoreset_mode(), "0, 1 or 2");
  }
  if (open->observation_dtype() == pb::DTYPE_UNSPECIFIED) open->set_observation_dtype(pb::FLOAT32);
  if (open->observation_dtype() != pb::FLOAT32 && open->observation_dtype() != pb::FLOAT64) {
    return InvalidNumber("observation_dtype", open->observation_dtype(), "FLOAT32 or FLOAT64");
  }
  if (!open->has_seed()) {
    uint64_t seed = 0;
    if (getrandom(&seed, sizeof(seed), 0) != sizeof(seed)) {
      return Status(StatusCode::kInternal, "the system gives no random numbers");
    }
    open->set_seed(seed >> 1);  // fits a signed integer everywhere
  }
  return Status();
}

std::string ModelFileOf(const pb::OpenRequest& open) {
  for (const pb::NamedArgument& item : open.perturbations()) {
    if (item.name() == "model" && !item.argument().empty()) return item.argument();
  }
  return "";
}

}  // namespace b4mrl
