#include "server/datasets/identity.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <charconv>
#include <nlohmann/json.hpp>

#include "data/files/file_hash.h"
#include "server/environments/list.h"

namespace b4mrl {
namespace {

std::string Fingerprint(const std::string& text) { return Sha256OfText(text).substr(0, 32); }

}  // namespace

std::string VersionedEnvironment(const std::string& environment) {
  const Result<const EnvironmentEntry*> entry = FindEnvironment(environment);
  return entry.ok() ? fmt::format("{}-v{}", environment, (*entry)->version) : environment;
}

std::string ImportedFingerprint(const std::string& environment, const std::string& columns_sha256,
                                const CacheProperties& properties) {
  const nlohmann::json text = {environment, columns_sha256, properties};
  return Fingerprint("b4mrl dataset 2\n" +
                     text.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

std::string DerivedFingerprint(const std::string& fingerprint, const DerivedRows& rows) {
  if (rows.corruptions.empty() && rows.rule == TransitionRule::kStored) return fingerprint;
  std::string text = fmt::format("b4mrl derived dataset 2\n{}\n{}\n{}\n{}\n", fingerprint,
                                 rows.corruptions, rows.seed, TransitionRuleName(rows.rule));
  if (!rows.hidden.empty()) text += fmt::format("hidden {}\n", fmt::join(rows.hidden, " "));
  return Fingerprint(text);
}

uint64_t NoiseMatrix(const std::string& environment, const std::string& columns_sha256) {
  const std::string hash =
      Sha256OfText(fmt::format("b4mrl noise matrix 1\n{}\n{}\n", environment, columns_sha256));
  uint64_t matrix = 0;
  std::from_chars(hash.data(), hash.data() + 16, matrix, 16);
  return matrix;
}

}  // namespace b4mrl
