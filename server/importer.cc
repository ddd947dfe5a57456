#include "server/importer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "data/column_cache.h"
#include "data/file_hash.h"
#include "proto/base/unique_fd.h"
#include "server/import_dataset.h"
#include "server/sandbox.h"
#include "server/sandboxed_child.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr uint64_t kMemoryBytes = 2ull << 30;
constexpr uint64_t kMaxDescriptors = 64;
constexpr uint64_t kMinCpuSeconds = 60;
constexpr uint64_t kFileBytesPerCpuSecond = 4ull << 20;
// A compressed file unpacks to at most so many times its size before it counts as an attack.
constexpr uint64_t kMaxExpansion = 64;
constexpr uint64_t kMinFileBytes = 1ull << 30;

// True when nobody wrote to or replaced the file since `before`.
bool Unchanged(const struct stat& before, const struct stat& after) {
  return before.st_dev == after.st_dev && before.st_ino == after.st_ino &&
         before.st_size == after.st_size && before.st_mtim.tv_sec == after.st_mtim.tv_sec &&
         before.st_mtim.tv_nsec == after.st_mtim.tv_nsec;
}

Result<ImportResult> ImportInSandbox(const ImporterOptions& options) {
  const UniqueFd fd(open(options.file.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!fd.valid()) return IoError("open", options.file, errno);
  struct stat before {};
  if (fstat(fd.get(), &before) != 0) return IoError("inspect", options.file, errno);
  if (!S_ISREG(before.st_mode)) return InvalidArgument("file", options.file, "a regular file");
  // Hashing parses nothing, so it may come before the sandbox.
  B4MRL_ASSIGN_OR_RETURN(const std::string sha256, Sha256OfDescriptor(fd.get(), options.file));
  const auto file_bytes = static_cast<uint64_t>(before.st_size);
  SandboxOptions sandbox;
  sandbox.readable_paths = {options.file};
  sandbox.writable_folder = options.cache_folder;
  sandbox.memory_bytes = kMemoryBytes;
  sandbox.cpu_seconds = kMinCpuSeconds + file_bytes / kFileBytesPerCpuSecond;
  sandbox.file_bytes = std::max(kMinFileBytes, file_bytes * kMaxExpansion);
  sandbox.descriptors = kMaxDescriptors;
  B4MRL_RETURN_IF_ERROR(EnterSandbox(sandbox));
  B4MRL_ASSIGN_OR_RETURN(ImportResult result, ImportDataset(options, sha256));
  struct stat after {};
  if (stat(options.file.c_str(), &after) != 0 || !Unchanged(before, after)) {
    RemoveCache(fmt::format("{}/{}", options.cache_folder, result.fingerprint));
    return Status(StatusCode::kUnavailable, "the file changed while it was imported; try again");
  }
  return result;
}

std::string Answer(const Result<ImportResult>& result) {
  if (!result.ok()) return ErrorAnswer(result.status());
  Json answer;
  answer["ok"] = true;
  answer["fingerprint"] = result->fingerprint;
  answer["sha256"] = result->sha256;
  answer["rows"] = result->rows;
  return answer.dump();
}

bool IsFingerprint(const std::string& text) {
  return text.size() == 32 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

Result<ImportResult> ParseAnswer(const std::string& text) {
  const Status malformed(StatusCode::kDataLoss, "the importer gave no usable answer");
  const Json answer = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  const Json fingerprint = answer.value("fingerprint", Json());
  const Json sha256 = answer.value("sha256", Json());
  const Json rows = answer.value("rows", Json());
  if (!fingerprint.is_string() || !sha256.is_string() || !rows.is_number_unsigned()) {
    return malformed;
  }
  ImportResult result{fingerprint.get<std::string>(), sha256.get<std::string>(),
                      rows.get<uint64_t>()};
  if (!IsFingerprint(result.fingerprint)) return malformed;
  return result;
}

// What a child that did not end well has left behind.
void RemoveUnfinished(const std::string& cache_folder, pid_t id) {
  RemoveCache(fmt::format("{}/{}{}-0", cache_folder, kUnfinishedCachePrefix, id));
}

}  // namespace

int RunImporter(const ImporterOptions& options) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  const Result<ImportResult> result = ImportInSandbox(options);
  std::printf("%s\n", Answer(result).c_str());
  std::fflush(stdout);
  if (result.ok()) return 0;
  return result.status().code() == StatusCode::kInternal ? 1 : 3;
}

Result<ImportResult> ImportInChild(const std::string& program, const ImporterOptions& options,
                                   const Deadline& deadline, const std::atomic<bool>* cancelled) {
  const SandboxedChild child = {
      program,
      {"--role", "importer", "--file", options.file, "--cache", options.cache_folder},
      "the importer"};
  const ChildAnswer answer = RunSandboxedChild(child, deadline, cancelled);
  if (!answer.ended_well) RemoveUnfinished(options.cache_folder, answer.process_id);
  if (!answer.json.ok()) return answer.json.status().WithContext(options.file);
  Result<ImportResult> result = ParseAnswer(*answer.json);
  if (!result.ok()) return result.status().WithContext(options.file);
  return result;
}

}  // namespace b4mrl
