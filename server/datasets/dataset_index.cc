#include "server/datasets/dataset_index.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>

#include "data/columns/column_cache.h"
#include "data/files/atomic_file.h"
#include "data/files/file_hash.h"
#include "proto/wire/json_depth.h"
#include "server/datasets/provenance_json.h"

namespace b4mrl {
namespace {

using Json = nlohmann::json;

constexpr size_t kMaxEntryBytes = 64 * 1024;
constexpr int kMaxEntryDepth = 8;  // lists and objects inside each other
constexpr size_t kMaxFailures = 256;
constexpr int64_t kFailureMs = 600'000;

std::string StringOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_string() ? found->get<std::string>() : "";
}

uint64_t NumberOf(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_number_unsigned() ? found->get<uint64_t>() : 0;
}

}  // namespace

Result<FileIdentity> FileIdentity::Of(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return IoError("inspect", path, errno);
  // Unsigned, as a file may be of any year, and of those from 2262 on 64 bits hold no nanoseconds.
  const uint64_t modified_ns = static_cast<uint64_t>(info.st_mtim.tv_sec) * 1'000'000'000u +
                               static_cast<uint64_t>(info.st_mtim.tv_nsec);
  return FileIdentity{static_cast<uint64_t>(info.st_size), modified_ns, info.st_ino};
}

std::string DatasetIndex::KeyOf(const std::string& name) {
  return Sha256OfText(name).substr(0, 32);
}

std::string DatasetIndex::PathOf(const std::string& name) const {
  return fmt::format("{}/{}.json", folder_, KeyOf(name));
}

std::optional<ImportedFile> DatasetIndex::Find(const std::string& name,
                                               const FileIdentity& file) const {
  const Result<std::string> text = ReadSmallFile(PathOf(name), kMaxEntryBytes);
  if (!text.ok()) return std::nullopt;
  const Json json = ParseShallow<Json>(*text, kMaxEntryDepth);
  if (!json.is_object()) return std::nullopt;
  const FileIdentity known{NumberOf(json, "file_bytes"), NumberOf(json, "modified_ns"),
                           NumberOf(json, "inode")};
  const auto provenance = ProvenanceOf(json.value("provenance", Json()));
  ImportedFile imported{file,
                        StringOf(json, "sha256"),
                        StringOf(json, "columns_sha256"),
                        StringOf(json, "fingerprint"),
                        {NumberOf(json, "rows"), StringOf(json, "behaviour_policy"), {}}};
  if (known != file || !provenance.ok() || !IsHash128(imported.fingerprint)) return std::nullopt;
  imported.contents.provenance = *provenance;
  imported.contents.infers_timeouts = json.value("infers_timeouts", Json()) == true;
  return imported;
}

Status DatasetIndex::Add(const std::string& name, const ImportedFile& imported) const {
  const Json json = {{"name", name},
                     {"file_bytes", imported.file.bytes},
                     {"modified_ns", imported.file.modified_ns},
                     {"inode", imported.file.inode},
                     {"sha256", imported.sha256},
                     {"columns_sha256", imported.columns_sha256},
                     {"fingerprint", imported.fingerprint},
                     {"rows", imported.contents.rows},
                     {"behaviour_policy", PlainPolicy(imported.contents.behaviour_policy)},
                     {"infers_timeouts", imported.contents.infers_timeouts},
                     {"provenance", ToJson(imported.contents.provenance)}};
  return WriteSmallFile(PathOf(name), json.dump(-1, ' ', false, Json::error_handler_t::replace),
                        ModeInside(folder_) & 0666);
}

void DatasetIndex::AddFailure(const std::string& name, const FileIdentity& file, Status failure) {
  const std::lock_guard lock(mutex_);
  failures_.insert_or_assign(name,
                             Failure{file, std::move(failure), Deadline::AfterMs(kFailureMs)});
  if (failures_.size() <= kMaxFailures) return;
  failures_.erase(std::ranges::min_element(
      failures_, {}, [](const auto& entry) { return entry.second.forgotten.remaining_ms(); }));
}

Status DatasetIndex::FindFailure(const std::string& name, const FileIdentity& file) const {
  const std::lock_guard lock(mutex_);
  const auto found = failures_.find(name);
  const bool holds =
      found != failures_.end() && found->second.file == file && !found->second.forgotten.expired();
  return holds ? found->second.status : Status();
}

}  // namespace b4mrl
