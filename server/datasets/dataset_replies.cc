#include "server/datasets/dataset_replies.h"

#include <algorithm>
#include <string>

#include "proto/base/limits.h"
#include "proto/wire/named_arguments.h"

namespace b4mrl {
namespace {

// Bytes for the entries of a page, and bytes for the tag and length of each entry.
constexpr size_t kMaxListBytes = limits::kMaxEnvelopeBytes - 1024, kFieldBytes = 4;
// The longest texts about a file's origin that replies and listings carry.
constexpr size_t kMaxPolicyBytes = 200, kMaxEnvironmentBytes = 64;

// A file may hold any bytes, and a protobuf string only UTF-8.
std::string PlainText(const std::string& text, size_t max_bytes) {
  std::string plain = text.substr(0, max_bytes);
  std::ranges::replace_if(
      plain, [](char c) { return c < ' ' || c > '~'; }, '?');
  return plain;
}

void FillInfo(const DatasetFileInfo& info, pb::DatasetInfo* out) {
  out->set_name(info.name);
  out->set_rows(info.rows);
  out->set_file_bytes(info.file_bytes);
  out->set_sha256(info.sha256);
  out->set_behaviour_policy(PlainPolicy(info.behaviour_policy));
}

}  // namespace

std::string PlainPolicy(const std::string& text) { return PlainText(text, kMaxPolicyBytes); }

void FillList(const std::vector<DatasetFileInfo>& list, uint32_t first,
              pb::ListDatasetsReply* out) {
  out->set_total(static_cast<uint32_t>(list.size()));
  size_t bytes = 0;
  for (size_t i = first; i < list.size(); ++i) {
    pb::DatasetInfo* info = out->add_datasets();
    FillInfo(list[i], info);
    bytes += info->ByteSizeLong() + kFieldBytes;
    if (bytes <= kMaxListBytes) continue;
    out->mutable_datasets()->RemoveLast();
    return;
  }
}

void FillOpened(const OpenedDataset& opened, pb::OpenDatasetReply* out) {
  out->set_fingerprint(opened.fingerprint);
  FillInfo(opened.info, out->mutable_info());
  out->set_rows(opened.dataset->rows());
  out->set_observation_size(opened.dataset->columns().observation_size);
  out->set_action_size(opened.dataset->columns().action_size);
  AddNamedArguments(opened.corruptions, out->mutable_corruptions());
  for (const uint32_t dimension : opened.hidden_dimensions) out->add_hidden_dimensions(dimension);
  out->set_environment(PlainText(opened.environment, kMaxEnvironmentBytes));
}

}  // namespace b4mrl
