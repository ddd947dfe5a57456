#include "server/datasets/importer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "data/files/stored_bytes.h"
#include "proto/base/exit_codes.h"
#include "proto/base/unique_fd.h"
#include "proto/wire/json_depth.h"
#include "server/datasets/provenance_json.h"
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

// Of a file that is larger than the sandbox lets one be, the reason, which lies in what is
// imported: it would be as large the next time. `status` is another error, or OK.
Status WithoutTooLargeFile(const Status& status, const SandboxOptions& sandbox) {
  if (!IsIoErrorOf(status, EFBIG)) return status;
  return Status(
      StatusCode::kLimitExceeded,
      fmt::format("{}; one file of its cache takes more than {} bytes, allowed: {} times "
                  "the bytes that the file stores, {} at least, and what all caches may "
                  "take at most",
                  status.message(), sandbox.file_bytes, kMaxExpansion, kMinCacheFileBytes));
}

Result<ImportedDataset> ImportInSandbox(const ImporterOptions& options) {
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
  sandbox.alone = true;
  B4MRL_RETURN_IF_ERROR(EnterSandbox(sandbox));
  Result<ImportedDataset> imported =
      ImportDataset(options.file, ImportedCachePath(options.folder), options.max_cache_bytes);
  if (!imported.ok()) return WithoutTooLargeFile(imported.status(), sandbox);
  return imported;
}

std::string Answer(const Result<ImportedDataset>& imported) {
  if (!imported.ok()) return ErrorAnswer(imported.status());
  return Json({{"ok", true},
               {"rows", imported->rows},
               {"behaviour_policy", PlainPolicy(imported->behaviour_policy)},
               {"infers_timeouts", imported->infers_timeouts},
               {"provenance", ToJson(imported->provenance)}})
      .dump();
}

Result<ImportedDataset> ParseAnswer(const std::string& text) {
  const Json answer = ParseShallow<Json>(text, kMaxAnswerDepth);
  const Json rows = answer.value("rows", Json());
  const Json policy = answer.value("behaviour_policy", Json());
  if (!rows.is_number_unsigned() || !policy.is_string()) {
    return Status(StatusCode::kDataLoss, "the importer gave no usable answer");
  }
  ImportedDataset imported{rows.get<uint64_t>(), PlainPolicy(policy.get<std::string>()), {}};
  imported.infers_timeouts = answer.value("infers_timeouts", Json()) == true;
  B4MRL_ASSIGN_OR_RETURN(imported.provenance, ProvenanceOf(answer.value("provenance", Json())));
  return imported;
}

}  // namespace

std::string ImportedCachePath(const std::string& folder) { return folder + "/imported"; }

Status LateImport() {
  return Status(
      StatusCode::kUnavailable,
      "its import did not end in time; the file is crafted so, or the machine overloaded");
}

int RunImporter(const ImporterOptions& options) {
  DieWithParent();
  const Result<ImportedDataset> imported = ImportInSandbox(options);
  std::printf("%s\n", Answer(imported).c_str());
  std::fflush(stdout);
  if (imported.ok()) return kExitDone;
  return imported.status().code() == StatusCode::kInternal ? kExitFailed : kExitBadInput;
}

Result<ImportedDataset> ImportInChild(const std::string& program, const ImporterOptions& options,
                                      const Deadline& deadline,
                                      const std::atomic<bool>* cancelled) {
  const SandboxedChild child = {
      program,
      {"--role", "importer", "--file", options.file, "--cache-folder", options.folder,
       "--cache-bytes", std::to_string(options.max_cache_bytes)},
      "the importer"};
  const ChildAnswer answer = RunSandboxedChild(child, deadline, cancelled);
  Result<ImportedDataset> imported =
      answer.json.ok() ? ParseAnswer(*answer.json) : answer.json.status();
  if (imported.ok()) return imported;
  const Status& status = imported.status();
  const bool late = status.code() == StatusCode::kDeadlineExceeded;
  return (late ? LateImport() : status).WithContext(options.file);
}

}  // namespace b4mrl
