#include "server/shared_memory/shared_state.h"

#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include <algorithm>
#include <cerrno>
#include <ctime>
#include <utility>

namespace b4mrl {
namespace {

constexpr uint64_t kMagic = 0x62346d726c2d7368;  // "b4mrl-sh"
constexpr uint32_t kVersion = 2;

}  // namespace

std::string ChildName(uint32_t child) {
  if (child == kGatewayChild) return "gateway";
  if (child == kDatasetChild) return "dataset-worker";
  return fmt::format("worker-{}", child - kFirstWorkerChild);
}

int64_t MonotonicMs() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
  return now.tv_sec * 1'000 + now.tv_nsec / 1'000'000;
}

void SharedState::Unmap::operator()(SharedMemory* memory) const {
  munmap(memory, sizeof(SharedMemory));
}

Result<SharedState> SharedState::MapAll(UniqueFd fd) {
  void* address = mmap(nullptr, sizeof(SharedMemory), PROT_READ | PROT_WRITE,
                       MAP_SHARED | MAP_NORESERVE, fd.get(), 0);
  if (address == MAP_FAILED) return IoError("map", "shared memory", errno);
  SharedState state;
  state.fd_ = std::move(fd);
  state.memory_.reset(static_cast<SharedMemory*>(address));
  return state;
}

Result<SharedState> SharedState::Create(uint32_t worker_count, int64_t lease_ms) {
  UniqueFd fd(memfd_create("b4mrl-state", MFD_CLOEXEC));
  if (!fd.valid()) return IoError("create", "shared memory", errno);
  if (ftruncate(fd.get(), sizeof(SharedMemory)) != 0)
    return IoError("size", "shared memory", errno);
  B4MRL_ASSIGN_OR_RETURN(SharedState state, MapAll(std::move(fd)));
  // A new memfd reads as zeros, which is every record's initial state.
  SharedHeader& header = state.header();
  header.magic = kMagic;
  header.version = kVersion;
  header.worker_count = worker_count;
  header.lease_ms = lease_ms;
  header.start_ms = MonotonicMs();
  header.next_generation.store(1);
  return state;
}

Result<SharedState> SharedState::Map(int fd) {
  struct stat info {};
  if (fstat(fd, &info) != 0) return IoError("inspect", "shared memory", errno);
  if (info.st_size != static_cast<off_t>(sizeof(SharedMemory))) {
    return InvalidNumber("size of the shared memory", static_cast<double>(info.st_size),
                         std::to_string(sizeof(SharedMemory)));
  }
  B4MRL_ASSIGN_OR_RETURN(SharedState state, MapAll(UniqueFd(fd)));
  if (state.header().magic != kMagic || state.header().version != kVersion) {
    return Status(StatusCode::kVersionMismatch, "the shared memory is another version's");
  }
  return state;
}

uint32_t SharedState::worker_count() const {
  return std::min(memory_->header.worker_count, limits::kMaxWorkers);
}

SessionState SessionRecord::state() const {
  const SessionState by_gateway = granted.load(std::memory_order_acquire);
  if (by_gateway == SessionState::kFree) return by_gateway;
  const bool closed = closed_generation.load(std::memory_order_acquire) == generation.load();
  return closed ? SessionState::kClosed : by_gateway;
}

uint64_t SessionChecksum(const SessionRecord& record) {
  const uint64_t place = (uint64_t{record.first_lane.load()} << 32) | record.lane_count.load();
  const uint64_t token_hash =
      XXH3_64bits_withSeed(record.token.data(), record.token.size(), place + record.generation);
  const size_t size = std::min<size_t>(record.open_size, record.open.size());
  return XXH3_64bits_withSeed(record.open.data(), size, token_hash);
}

Status CheckSessionRecord(const SessionRecord& record) {
  const uint64_t end = uint64_t{record.first_lane.load()} + record.lane_count.load();
  if (end > limits::kMaxLanes || record.lane_count > limits::kMaxLanesPerSession ||
      record.open_size > record.open.size() || record.checksum != SessionChecksum(record)) {
    return Status(StatusCode::kDataLoss, "the session's record is damaged");
  }
  return Status();
}

std::string_view SessionToken(const SessionRecord& record) {
  return {reinterpret_cast<const char*>(record.token.data()), record.token.size()};
}

std::string_view SessionOpenBytes(const SessionRecord& record) {
  return {reinterpret_cast<const char*>(record.open.data()), record.open_size};
}

}  // namespace b4mrl
