#include "proto/base/status.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <vector>

#include "proto/base/names.h"

namespace b4mrl {
namespace {

// By the codes' numbers.
constexpr std::array<std::string_view, 16> kCodeNames = {
    "OK",
    "INVALID_ARGUMENT",
    "UNKNOWN_NAME",
    "UNSUPPORTED",
    "BUSY",
    "STALE",
    "GAP",
    "LIMIT_EXCEEDED",
    "DEADLINE_EXCEEDED",
    "UNAVAILABLE",
    "VERSION_MISMATCH",
    "SESSION_LOST",
    "DATA_LOSS",
    "IO_ERROR",
    "FAILED_PRECONDITION",
    "INTERNAL",
};
static_assert(kCodeNames.size() == static_cast<size_t>(StatusCode::kInternal) + 1);

size_t EditDistance(std::string_view a, std::string_view b) {
  std::vector<size_t> row(b.size() + 1);
  for (size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (size_t i = 1; i <= a.size(); ++i) {
    size_t diagonal = row[0];
    row[0] = i;
    for (size_t j = 1; j <= b.size(); ++j) {
      const size_t substitution = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({row[j] + 1, row[j - 1] + 1, substitution});
    }
  }
  return row[b.size()];
}

// The common beginning of two names up to its last '/', as "HalfCheetah/"; "" if there is none.
std::string_view CommonFolder(std::string_view a, std::string_view b) {
  const auto differing = std::ranges::mismatch(a, b).in1;
  const std::string_view common = a.substr(0, static_cast<size_t>(differing - a.begin()));
  return common.substr(0, common.rfind('/') + 1);
}

}  // namespace

std::string_view StatusCodeName(StatusCode code) {
  const auto number = static_cast<size_t>(code);
  return number < kCodeNames.size() ? kCodeNames[number] : "UNKNOWN";
}

std::string Status::ToString() const {
  if (ok()) return "OK";
  return fmt::format("{}: {}", StatusCodeName(code_), message_);
}

Status Status::WithContext(std::string_view context) const {
  if (ok()) return *this;
  return Status(code_, fmt::format("{}: {}", context, message_));
}

bool Status::recoverable() const {
  return code_ == StatusCode::kBusy || code_ == StatusCode::kDeadlineExceeded ||
         code_ == StatusCode::kUnavailable || code_ == StatusCode::kLimitExceeded;
}

Status InvalidArgument(std::string_view name, std::string_view value, std::string_view allowed) {
  // The value may come from a peer: cut a long value, as it would hide the message around it.
  constexpr size_t kMaxShown = 100;
  const std::string_view shown = value.substr(0, kMaxShown);
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{} is '{}'{}, allowed: {}", name, shown,
                            value.size() > kMaxShown ? "..." : "", allowed));
}

Status InvalidNumber(std::string_view name, double value, std::string_view allowed) {
  return Status(StatusCode::kInvalidArgument,
                fmt::format("{} is {}, allowed: {}", name, value, allowed));
}

Status IoError(std::string_view action, std::string_view path, int error_number) {
  return Status(StatusCode::kIoError,
                fmt::format("cannot {} {}: {}", action, path, std::strerror(error_number)));
}

bool IsIoErrorOf(const Status& status, int error_number) {
  return status.code() == StatusCode::kIoError &&
         status.message().ends_with(std::strerror(error_number));
}

void NearestName::Consider(std::string_view candidate) {
  // Names are short; skip a long name from a peer, whose edit distance would cost quadratic time.
  if (name_.size() > 128 || candidate.size() > 128) return;
  const size_t folder = CommonFolder(name_, candidate).size();
  const std::string_view own = std::string_view(name_).substr(folder);
  std::string_view other = candidate.substr(folder);
  // Who leaves out the version means any.
  if (VersionOf(own).empty()) other = WithoutVersion(other);
  const size_t distance = EditDistance(own, other);
  if (distance < distance_ && distance * 3 <= std::max(own.size(), other.size())) {
    distance_ = distance;
    nearest_ = std::string(candidate);
  }
}

Status UnknownNameOf(std::string_view kind, std::string_view name, std::string_view known_list,
                     const NearestName& nearest) {
  std::string message = fmt::format("unknown {} '{}'", kind, name.substr(0, 100));
  message += nearest.nearest() ? fmt::format("; did you mean '{}'?", *nearest.nearest()) : ";";
  // A list that fills the screen would hide the name that was meant.
  constexpr size_t kMaxShown = 1000;
  const bool is_cut = known_list.size() > kMaxShown;
  const std::string_view shown =
      is_cut ? known_list.substr(0, known_list.rfind(", ", kMaxShown)) : known_list;
  message += fmt::format(" known: {}{}", shown.empty() ? "none" : shown, is_cut ? ", ..." : "");
  return Status(StatusCode::kUnknownName, message);
}

}  // namespace b4mrl
