#include "algorithms/experience/replay_buffer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "algorithms/base/replay_file.h"

namespace b4mrl {
namespace {

constexpr uint64_t kGrowthRecords = 65'536;

}  // namespace

ReplayBuffer::ReplayBuffer(const Options& options, UniqueFd fd, std::string path)
    : options_(options),
      record_floats_(2 * static_cast<uint64_t>(options.observation_size) + options.action_size + 2),
      fd_(std::move(fd)),
      path_(std::move(path)) {}

ReplayBuffer::ReplayBuffer(ReplayBuffer&& other) noexcept
    : options_(other.options_),
      record_floats_(other.record_floats_),
      fd_(std::move(other.fd_)),
      path_(std::move(other.path_)),
      mapping_(std::exchange(other.mapping_, nullptr)),
      mapping_bytes_(std::exchange(other.mapping_bytes_, 0)),
      reserved_(std::exchange(other.reserved_, 0)),
      first_(other.first_),
      length_(other.length_) {}

ReplayBuffer::~ReplayBuffer() {
  if (mapping_ != nullptr) munmap(mapping_, mapping_bytes_);
}

Result<ReplayBuffer> ReplayBuffer::InMemory(const Options& options) {
  ReplayBuffer buffer(options, UniqueFd(), "memory");
  B4MRL_RETURN_IF_ERROR(buffer.Reserve(options.capacity));
  return buffer;
}

Result<ReplayBuffer> ReplayBuffer::CreateFile(const std::string& path, const Options& options) {
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!fd.valid()) return IoError("create", path, errno);
  ReplayBuffer buffer(options, std::move(fd), path);
  B4MRL_RETURN_IF_ERROR(buffer.Reserve(kGrowthRecords));
  ReplayHeader header;
  header.observation_size = static_cast<uint32_t>(options.observation_size);
  header.action_size = static_cast<uint32_t>(options.action_size);
  std::memcpy(buffer.mapping_, &header, sizeof(header));
  return buffer;
}

Result<ReplayBuffer> ReplayBuffer::ResumeFile(const std::string& path, const Options& options,
                                              uint64_t length) {
  UniqueFd fd(open(path.c_str(), O_RDWR | O_CLOEXEC));
  if (!fd.valid()) return IoError("open", path, errno);
  struct stat info {};
  if (fstat(fd.get(), &info) != 0) return IoError("read the size of", path, errno);
  ReplayHeader header;
  if (pread(fd.get(), &header, sizeof(header), 0) != static_cast<ssize_t>(sizeof(header)) ||
      header.magic != kReplayMagic ||
      header.observation_size != static_cast<uint32_t>(options.observation_size) ||
      header.action_size != static_cast<uint32_t>(options.action_size)) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} is no replay file of {} observation and {} action values", path,
                              options.observation_size, options.action_size));
  }
  ReplayBuffer buffer(options, std::move(fd), path);
  const uint64_t stored =
      (static_cast<uint64_t>(info.st_size) - kReplayHeaderBytes) / buffer.record_bytes();
  if (static_cast<uint64_t>(info.st_size) < kReplayHeaderBytes || stored < length) {
    return Status(StatusCode::kDataLoss,
                  fmt::format("{} has fewer than the checkpoint's {} records", path, length));
  }
  B4MRL_RETURN_IF_ERROR(buffer.Reserve(length + kGrowthRecords));
  buffer.length_ = length;
  buffer.first_ = length > options.capacity ? length - options.capacity : 0;
  return buffer;
}

Status ReplayBuffer::Reserve(uint64_t records) {
  const uint64_t header = fd_.valid() ? kReplayHeaderBytes : 0;
  const uint64_t bytes = header + records * record_bytes();
  if (fd_.valid()) {
    int error = EINTR;  // which a signal causes on some file systems
    while (error == EINTR) error = posix_fallocate(fd_.get(), 0, static_cast<off_t>(bytes));
    if (error != 0) return IoError("reserve space in", path_, error);
  }
  if (mapping_ != nullptr) munmap(mapping_, mapping_bytes_);
  mapping_ = nullptr;
  const int flags = fd_.valid() ? MAP_SHARED : MAP_PRIVATE | MAP_ANONYMOUS;
  void* mapping = mmap(nullptr, bytes, PROT_READ | PROT_WRITE, flags, fd_.get(), 0);
  if (mapping == MAP_FAILED && !fd_.valid()) {
    return Status(StatusCode::kFailedPrecondition,
                  fmt::format("not enough memory for a pool of {} transitions", records));
  }
  if (mapping == MAP_FAILED) return IoError("map", path_, errno);
  mapping_ = static_cast<std::byte*>(mapping);
  mapping_bytes_ = bytes;
  reserved_ = records;
  return Status();
}

float* ReplayBuffer::Record(uint64_t number) const {
  const uint64_t slot = fd_.valid() ? number : number % reserved_;
  const uint64_t offset = (fd_.valid() ? kReplayHeaderBytes : 0) + slot * record_bytes();
  return reinterpret_cast<float*>(mapping_ + offset);
}

Status ReplayBuffer::Append(const Transition& transition) {
  if (fd_.valid() && length_ == reserved_) {
    B4MRL_RETURN_IF_ERROR(Reserve(reserved_ + kGrowthRecords));
  }
  float* out = Record(length_);
  out = std::copy(transition.observation.begin(), transition.observation.end(), out);
  out = std::copy(transition.action.begin(), transition.action.end(), out);
  out = std::copy(transition.next_observation.begin(), transition.next_observation.end(), out);
  *out++ = transition.reward;
  *out = transition.terminated ? 0.0f : 1.0f;
  ++length_;
  if (size() > options_.capacity) first_ = length_ - options_.capacity;
  return Status();
}

void ReplayBuffer::DropBefore(uint64_t first) { first_ = std::clamp(first, first_, length_); }

void ReplayBuffer::Get(uint64_t number, int column, BatchBuffer& batch) const {
  const int observation = options_.observation_size;
  const int action = options_.action_size;
  const float* record = Record(number);
  std::copy_n(record, observation, batch.observations.view().column(column));
  record += observation;
  std::copy_n(record, action, batch.actions.view().column(column));
  record += action;
  std::copy_n(record, observation, batch.next_observations.view().column(column));
  record += observation;
  batch.rewards[column] = record[0];
  batch.not_terminated[column] = record[1];
}

void ReplayBuffer::Sample(Rng& rng, int first_column, int rows, BatchBuffer& batch) const {
  for (int i = 0; i < rows; ++i) Get(first_ + rng.Below(size()), first_column + i, batch);
}

Status ReplayBuffer::Sync() {
  if (!fd_.valid()) return Status();
  if (msync(mapping_, mapping_bytes_, MS_SYNC) != 0) return IoError("write", path_, errno);
  if (fsync(fd_.get()) != 0) return IoError("sync", path_, errno);
  return Status();
}

}  // namespace b4mrl
