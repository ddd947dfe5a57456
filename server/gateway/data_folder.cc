#include "server/gateway/data_folder.h"

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <system_error>
#include <utility>

#include "proto/base/folders.h"

namespace b4mrl {
namespace {

constexpr int64_t kPatienceMs = 100;  // answers of folders that do answer take microseconds
// Without any answer yet, there is none to give instead; and a machine is busy where daemons start.
constexpr int64_t kFirstPatienceMs = 500;

std::string Absolute(const std::string& folder) {
  std::error_code error;
  const std::string absolute = std::filesystem::absolute(folder, error).lexically_normal().string();
  return error ? folder : absolute;
}

}  // namespace

struct DataFolder::State {
  std::mutex mutex;
  std::condition_variable done;
  bool is_busy = false;
  std::optional<uint64_t> identity;  // nothing before the first answer
};

DataFolder::DataFolder(const std::string& path)
    : path_(Absolute(path)), state_(std::make_shared<State>()) {
  TryRun(Look());
}

std::function<void()> DataFolder::Look() const {
  return [state = state_, path = path_] {
    const uint64_t identity = FolderIdentity(path);
    const std::lock_guard lock(state->mutex);
    state->identity = identity;
  };
}

bool DataFolder::TryRun(std::function<void()> work) {
  thread_.RunCompletions();
  {
    const std::lock_guard lock(state_->mutex);
    if (state_->is_busy) return false;
    state_->is_busy = true;
  }
  is_late_ = false;
  thread_.Submit([state = state_, work = std::move(work)]() -> BackgroundThread::Completion {
    work();
    {
      const std::lock_guard lock(state->mutex);
      state->is_busy = false;
    }
    state->done.notify_all();
    return [] {};
  });
  return true;
}

bool DataFolder::AwaitIdle(const Deadline& deadline) {
  std::unique_lock lock(state_->mutex);
  if (is_late_ && state_->is_busy) return false;
  const auto is_idle = [this] { return !state_->is_busy; };
  is_late_ = !state_->done.wait_until(lock, deadline.at(), is_idle);
  return !is_late_;
}

uint64_t DataFolder::Identity() {
  std::unique_lock lock(state_->mutex);
  const Deadline deadline = Deadline::AfterMs(state_->identity ? kPatienceMs : kFirstPatienceMs);
  lock.unlock();
  if (AwaitIdle(deadline) && TryRun(Look())) AwaitIdle(deadline);
  lock.lock();
  return state_->identity.value_or(0);
}

}  // namespace b4mrl
