// The reply to a Catalogue request: all environments and perturbations, and the models of users. It
// takes milliseconds to put together and changes only with the models folder, so it is kept in
// serialised form. Thread rule: the gateway's main thread.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/base/status.h"
#include "proto/wire/frame.h"

namespace b4mrl {

class Catalogue {
 public:
  explicit Catalogue(std::string models_folder) : models_folder_(std::move(models_folder)) {}

  // The envelope that answers request `request_id`; kInvalidArgument above
  // limits::kMaxEnvelopeBytes.
  Result<Frame> Envelope(uint64_t request_id);

 private:
  // Lists the models folder unless its time of change says that it holds what it did.
  void ReadFolder();
  void Serialise();

  const std::string models_folder_;
  std::vector<std::string> files_;
  std::optional<int64_t> folder_changed_ns_;  // when files_ was read; unset if it may be outdated
  std::string serialised_;                    // all of a pb::Reply but its request id
};

}  // namespace b4mrl
