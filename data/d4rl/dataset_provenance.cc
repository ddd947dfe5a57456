#include "data/d4rl/dataset_provenance.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "data/d4rl/agent_file.h"
#include "proto/base/limits.h"
#include "proto/base/spec.h"

namespace b4mrl {
namespace {

constexpr std::string_view kLicense = "metadata/license";

std::string RecordingEntry(std::string_view name) {
  return fmt::format("metadata/recording/{}", name);
}

Status CheckText(std::string_view path, std::string_view text) {
  if (text.size() <= kMaxProvenanceText) return Status();
  return InvalidNumber(fmt::format("length of '{}'", path), text.size(),
                       fmt::format("0..{} bytes", kMaxProvenanceText));
}

Status WriteText(Hdf5Writer& file, const std::string& path, std::string_view text) {
  B4MRL_RETURN_IF_ERROR(CheckText(path, text));
  return file.WriteString(path, text);
}

// Reads an entry of B4MRL's own, which may be absent; `text` then keeps its value.
Status ReadText(const Hdf5Reader& file, const std::string& path, std::string* text) {
  if (!file.Exists(path)) return Status();
  B4MRL_ASSIGN_OR_RETURN(*text, file.ReadString(path));
  return CheckText(path, *text);
}

// Reads an entry that files of others may hold in any form; "" where it is not one text.
std::string ReadForeignText(const Hdf5Reader& file, std::string_view path) {
  const Result<std::string> text = file.ReadText(path);
  return text.ok() && text->size() <= kMaxProvenanceText ? *text : "";
}

// The elements of "a,b,c"; none for "".
std::vector<std::string_view> Split(std::string_view text, char separator) {
  std::vector<std::string_view> elements;
  if (text.empty()) return elements;
  while (true) {
    const size_t end = text.find(separator);
    elements.push_back(text.substr(0, end));
    if (end == text.npos) return elements;
    text.remove_prefix(end + 1);
  }
}

// One value of every part, as the file holds them: a list joined by `separator`.
template <typename Get>
std::string Joined(const std::vector<RecordedPart>& parts, std::string_view separator, Get get) {
  std::vector<std::string> values;
  for (const RecordedPart& part : parts) values.push_back(fmt::format("{}", get(part)));
  return fmt::format("{}", fmt::join(values, separator));
}

Status WriteParts(Hdf5Writer& file, const std::vector<RecordedPart>& parts) {
  const auto policy = [](const RecordedPart& part) { return part.policy; };
  const auto sha256 = [](const RecordedPart& part) { return part.policy_sha256; };
  const auto seed = [](const RecordedPart& part) { return part.seed; };
  const auto rows = [](const RecordedPart& part) { return part.rows; };
  B4MRL_RETURN_IF_ERROR(WriteText(file, RecordingEntry("policies"), Joined(parts, ";", policy)));
  B4MRL_RETURN_IF_ERROR(
      WriteText(file, RecordingEntry("policies_sha256"), Joined(parts, ",", sha256)));
  B4MRL_RETURN_IF_ERROR(WriteText(file, RecordingEntry("seeds"), Joined(parts, ",", seed)));
  return WriteText(file, RecordingEntry("rows"), Joined(parts, ",", rows));
}

// Reads the list `name`, which must have `count` elements.
Result<std::vector<std::string>> ReadList(const Hdf5Reader& file, std::string_view name,
                                          char separator, size_t count) {
  std::string text;
  B4MRL_RETURN_IF_ERROR(ReadText(file, RecordingEntry(name), &text));
  std::vector<std::string_view> elements = Split(text, separator);
  if (elements.empty() && count == 1) elements.emplace_back();  // one empty element
  if (elements.size() != count) {
    return InvalidNumber(fmt::format("number of elements of '{}'", RecordingEntry(name)),
                         elements.size(),
                         fmt::format("{}, as '{}' has", count, RecordingEntry("rows")));
  }
  return std::vector<std::string>(elements.begin(), elements.end());
}

Result<std::vector<RecordedPart>> ReadParts(const Hdf5Reader& file) {
  std::string text;
  B4MRL_RETURN_IF_ERROR(ReadText(file, RecordingEntry("rows"), &text));
  const std::vector<std::string_view> rows = Split(text, ',');
  if (rows.empty()) return std::vector<RecordedPart>();
  B4MRL_ASSIGN_OR_RETURN(auto policies, ReadList(file, "policies", ';', rows.size()));
  B4MRL_ASSIGN_OR_RETURN(auto hashes, ReadList(file, "policies_sha256", ',', rows.size()));
  B4MRL_ASSIGN_OR_RETURN(const auto seeds, ReadList(file, "seeds", ',', rows.size()));
  std::vector<RecordedPart> parts;
  for (size_t i = 0; i < rows.size(); ++i) {
    RecordedPart part{std::move(policies[i]), std::move(hashes[i])};
    B4MRL_ASSIGN_OR_RETURN(part.seed,
                           ParseUnsigned(RecordingEntry("seeds"), seeds[i], 0, UINT64_MAX));
    B4MRL_ASSIGN_OR_RETURN(
        part.rows, ParseUnsigned(RecordingEntry("rows"), rows[i], 1, limits::kMaxDatasetRows));
    parts.push_back(std::move(part));
  }
  return parts;
}

Status ReadHidden(const Hdf5Reader& file, std::vector<uint32_t>* hidden) {
  std::string text;
  B4MRL_RETURN_IF_ERROR(ReadText(file, RecordingEntry("hidden"), &text));
  for (const std::string_view element : Split(text, ',')) {
    B4MRL_ASSIGN_OR_RETURN(
        const uint64_t dimension,
        ParseUnsigned(RecordingEntry("hidden"), element, 0, limits::kMaxObservationDimensions - 1));
    hidden->push_back(static_cast<uint32_t>(dimension));
  }
  return Status();
}

Status ReadHistory(const Hdf5Reader& file, uint32_t* history_length) {
  if (!file.Exists(RecordingEntry("history"))) return Status();
  B4MRL_ASSIGN_OR_RETURN(const double value, file.ReadNumber(RecordingEntry("history")));
  if (!(value >= 1 && value <= kMaxAgentHistory && value == std::floor(value))) {
    return InvalidNumber(RecordingEntry("history"), value,
                         fmt::format("whole numbers in 1..{}", kMaxAgentHistory));
  }
  *history_length = static_cast<uint32_t>(value);
  return Status();
}

Status CheckPart(const RecordedPart& part) {
  if (part.policy.find(';') != part.policy.npos) {
    return InvalidArgument("behaviour policy of a recording", part.policy, "text without ';'");
  }
  if (part.policy_sha256.find_first_not_of("0123456789abcdef") != part.policy_sha256.npos) {
    return InvalidArgument("SHA-256 of a behaviour policy", part.policy_sha256,
                           "lower-case hexadecimal digits");
  }
  if (part.rows >= 1 && part.rows <= limits::kMaxDatasetRows) return Status();
  return InvalidNumber("rows of a recording", part.rows,
                       fmt::format("1..{}", limits::kMaxDatasetRows));
}

}  // namespace

Status DatasetProvenance::Validate() const {
  for (const ProvenanceText& entry : kProvenanceTexts) {
    B4MRL_RETURN_IF_ERROR(CheckText(RecordingEntry(entry.name), this->*entry.text));
  }
  B4MRL_RETURN_IF_ERROR(CheckText(kLicense, license));
  const bool ascending =
      std::ranges::adjacent_find(hidden_dimensions, std::ranges::greater_equal()) ==
      hidden_dimensions.end();
  if (!ascending || (!hidden_dimensions.empty() &&
                     hidden_dimensions.back() >= limits::kMaxObservationDimensions)) {
    return InvalidArgument(
        RecordingEntry("hidden"), fmt::format("{}", fmt::join(hidden_dimensions, ",")),
        fmt::format("ascending numbers in 0..{}", limits::kMaxObservationDimensions - 1));
  }
  if (history_length == 0 || history_length > kMaxAgentHistory) {
    return InvalidNumber(RecordingEntry("history"), history_length,
                         fmt::format("1..{}", kMaxAgentHistory));
  }
  if (parts.size() > kMaxRecordedParts) {
    return InvalidNumber("number of parts of a recording", parts.size(),
                         fmt::format("0..{}", kMaxRecordedParts));
  }
  for (const RecordedPart& part : parts) B4MRL_RETURN_IF_ERROR(CheckPart(part));
  return Status();
}

Status DatasetProvenance::CheckHidden(uint32_t observation_size) const {
  if (hidden_dimensions.empty() || hidden_dimensions.back() < observation_size) return Status();
  return InvalidNumber("hidden dimension in metadata/recording", hidden_dimensions.back(),
                       fmt::format("0..{}", observation_size - 1));
}

Status WriteDatasetProvenance(Hdf5Writer& file, const DatasetProvenance& provenance) {
  B4MRL_RETURN_IF_ERROR(provenance.Validate());
  for (const ProvenanceText& entry : kProvenanceTexts) {
    B4MRL_RETURN_IF_ERROR(WriteText(file, RecordingEntry(entry.name), provenance.*entry.text));
  }
  B4MRL_RETURN_IF_ERROR(WriteText(file, RecordingEntry("hidden"),
                                  fmt::format("{}", fmt::join(provenance.hidden_dimensions, ","))));
  B4MRL_RETURN_IF_ERROR(file.WriteInteger(RecordingEntry("history"), provenance.history_length));
  B4MRL_RETURN_IF_ERROR(WriteParts(file, provenance.parts));
  return WriteText(file, std::string(kLicense), provenance.license);
}

Result<DatasetProvenance> ReadDatasetProvenance(const Hdf5Reader& file) {
  DatasetProvenance provenance;
  provenance.environment = ReadForeignText(file, "metadata/environment");
  for (const ProvenanceText& entry : kProvenanceTexts) {
    B4MRL_RETURN_IF_ERROR(ReadText(file, RecordingEntry(entry.name), &(provenance.*entry.text)));
  }
  B4MRL_RETURN_IF_ERROR(ReadHidden(file, &provenance.hidden_dimensions));
  B4MRL_RETURN_IF_ERROR(ReadHistory(file, &provenance.history_length));
  B4MRL_ASSIGN_OR_RETURN(provenance.parts, ReadParts(file));
  provenance.license = ReadForeignText(file, kLicense);
  B4MRL_RETURN_IF_ERROR(provenance.Validate());
  return provenance;
}

}  // namespace b4mrl
