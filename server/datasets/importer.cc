#include "server/datasets/importer.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "data/d4rl/import_dataset.h"
#include "data/files/stored_bytes.h"
#include "proto/base/unique_fd.h"
#include "server/sandbox/sandbox.h"
#include "server/sandbox/sandboxed_child.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kMemoryBytes = 2ull << 30;
constexpr uint64_t kMaxDescriptors = 64;
constexpr uint64_t kMinCpuSeconds = 60, kMaxCpuSeconds = 1800;
constexpr uint64_t kFileBytesPerCpuSecond = 4ull << 20;
// Greatest ratio of a file's unpacked to its stored bytes; beyond it the file counts as an attack.
constexpr uint64_t kMaxExpansion = 64;
constexpr uint64_t kMinCacheFileBytes = 1ull << 30;

Result<uint64_t> ImportInSandbox(const ImporterOptions& options) {
  const UniqueFd fd(open(options.file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) return IoError("open", options.file, errno);
  struct stat info {};
  if (fstat(fd.get(), &info) != 0) return IoError("inspect", options.file, errno);
  if (!S_ISREG(info.st_mode)) return InvalidArgument("file", options.file, "a regular file");
  const uint64_t stored_bytes = StoredBytes(fd.get());
  SandboxOptions sandbox;
  sandbox.readable_paths = {options.file};
  sandbox.writable_folder = options.folder;
  sandbox.memory_bytes = kMemoryBytes;
  sandbox.cpu_seconds =
      std::min(kMinCpuSeconds + stored_bytes / kFileBytesPerCpuSecond, kMaxCpuSeconds);
  sandbox.file_bytes =
      std::min(std::max(kMinCacheFileBytes, stored_bytes * kMaxExpansion), options.max_cache_bytes);
  sandbox.descriptors = kMaxDescriptors;
  B4MRL_RETURN_IF_ERROR(EnterSandbox(sandbox));
  return ImportDataset(options.file, ImportedCachePath(options.folder), options.max_cache_bytes);
}

std::string Answer(const Result<uint64_t>& rows) {
  if (!rows.ok()) return ErrorAnswer(rows.status());
  return Json({{"ok", true}, {"rows", *rows}}).dump();
}

Result<uint64_t> ParseAnswer(const std::string& text) {
  const Json answer = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  const Json rows = answer.value("rows", Json());
  if (rows.is_number_unsigned()) return rows.get<uint64_t>();
  return Status(StatusCode::kDataLoss, "the importer gave no usable answer");
}

}  // namespace

std::string ImportedCachePath(const std::string& folder) { return folder + "/imported"; }

int RunImporter(const ImporterOptions& options) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const Result<uint64_t> rows = ImportInSandbox(options);
  std::printf("%s\n", Answer(rows).c_str());
  std::fflush(stdout);
  if (rows.ok()) return 0;
  return rows.status().code() == StatusCode::kInternal ? 1 : 3;
}

Result<uint64_t> ImportInChild(const std::string& program, const ImporterOptions& options,
                               const Deadline& deadline, const std::atomic<bool>* cancelled) {
  const SandboxedChild child = {
      program,
      {"--role", "importer", "--file", options.file, "--cache", options.folder, "--cache-bytes",
       std::to_string(options.max_cache_bytes)},
      "the importer"};
  const ChildAnswer answer = RunSandboxedChild(child, deadline, cancelled);
  const Result<uint64_t> rows = answer.json.ok() ? ParseAnswer(*answer.json) : answer.json.status();
  if (rows.ok()) return rows;
  const bool late = rows.status().code() == StatusCode::kDeadlineExceeded;
  return Status(late ? StatusCode::kDataLoss : rows.status().code(), rows.status().message())
      .WithContext(options.file);
}

}  // namespace b4mrl
