// The daemon's data folder, as far as the gateway uses it: looked at on a thread of its own, since
// a folder on a network may not answer for hours, and the gateway must. Thread rule: one thread.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "proto/base/clock.h"
#include "server/process/background_thread.h"

namespace b4mrl {

class DataFolder {
 public:
  explicit DataFolder(const std::string& path);

  const std::string& path() const { return path_; }  // absolute
  // FolderIdentity: 0 if there is no such folder, or if it has not answered yet. Waits for the
  // answer for 0.1 s, for the first one 0.5 s, and not at all while an earlier look has none; then
  // it is that of the last look.
  uint64_t Identity();
  // Has `work` done on the folder's thread; false while earlier work is not done.
  bool TryRun(std::function<void()> work);

 private:
  struct State;
  std::function<void()> Look() const;
  // Whether all work is done, or is by then; later calls do not wait for what was late once.
  bool AwaitIdle(const Deadline& deadline);

  const std::string path_;
  const std::shared_ptr<State> state_;
  bool is_late_ = false;  // the work that is under way
  BackgroundThread thread_;
};

}  // namespace b4mrl
