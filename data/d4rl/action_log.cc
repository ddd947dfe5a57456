#include "data/d4rl/action_log.h"

#include <fmt/format.h>

#include "data/hdf5/hdf5_file.h"
#include "proto/base/limits.h"

namespace b4mrl {
namespace {

Status ReadTexts(const Hdf5Reader& file, ActionLog* log) {
  B4MRL_ASSIGN_OR_RETURN(log->environment, file.ReadString("metadata/environment"));
  B4MRL_ASSIGN_OR_RETURN(log->simulator, file.ReadString("metadata/simulator"));
  B4MRL_ASSIGN_OR_RETURN(log->command, file.ReadString("metadata/command"));
  B4MRL_ASSIGN_OR_RETURN(log->replay_sha256, file.ReadString("metadata/replay_sha256"));
  B4MRL_ASSIGN_OR_RETURN(const std::string autoreset, file.ReadString("metadata/autoreset"));
  if (autoreset == "same_step") return Status();
  return InvalidArgument("autoreset of an action log", autoreset, "same_step");
}

}  // namespace

Result<ActionLog> ReadActionLog(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Reader file, Hdf5Reader::Open(path));
  ActionLog log;
  B4MRL_RETURN_IF_ERROR(ReadTexts(file, &log).WithContext(path));
  B4MRL_ASSIGN_OR_RETURN(const double seed, file.ReadNumber("metadata/seed"));
  B4MRL_ASSIGN_OR_RETURN(const double lanes, file.ReadNumber("metadata/lanes"));
  if (!(seed >= 0 && seed <= 1e15)) return InvalidNumber("seed of an action log", seed, "0..1e15");
  if (lanes != 1) return InvalidNumber("lanes of an action log", lanes, "1");
  log.seed = static_cast<uint64_t>(seed);
  B4MRL_ASSIGN_OR_RETURN(const Hdf5Column actions, file.OpenColumn("actions"));
  if (actions.shape().size() != 2 || actions.width() > limits::kMaxActionDimensions ||
      actions.rows() == 0 || actions.rows() > limits::kMaxDatasetRows) {
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("{}: actions are not a matrix of at most {} rows and {} columns",
                              path, limits::kMaxDatasetRows, limits::kMaxActionDimensions));
  }
  log.rows = actions.rows();
  log.action_size = static_cast<uint32_t>(actions.width());
  log.actions.resize(log.rows * log.action_size);
  B4MRL_RETURN_IF_ERROR(actions.Read(0, log.actions));
  return log;
}

}  // namespace b4mrl
