#include "proto/base/status.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <vector>

namespace b4mrl {
namespace {

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

}  // namespace

std::string_view StatusCodeName(StatusCode code) {
  switch (code) {
    case StatusCode::kOk:
      return "OK";
    case StatusCode::kInvalidArgument:
      return "INVALID_ARGUMENT";
    case StatusCode::kUnknownName:
      return "UNKNOWN_NAME";
    case StatusCode::kUnsupported:
      return "UNSUPPORTED";
    case StatusCode::kBusy:
      return "BUSY";
    case StatusCode::kStale:
      return "STALE";
    case StatusCode::kGap:
      return "GAP";
    case StatusCode::kLimitExceeded:
      return "LIMIT_EXCEEDED";
    case StatusCode::kDeadlineExceeded:
      return "DEADLINE_EXCEEDED";
    case StatusCode::kUnavailable:
      return "UNAVAILABLE";
    case StatusCode::kVersionMismatch:
      return "VERSION_MISMATCH";
    case StatusCode::kSessionLost:
      return "SESSION_LOST";
    case StatusCode::kDataLoss:
      return "DATA_LOSS";
    case StatusCode::kIoError:
      return "IO_ERROR";
    case StatusCode::kFailedPrecondition:
      return "FAILED_PRECONDITION";
    case StatusCode::kInternal:
      return "INTERNAL";
  }
  return "UNKNOWN";
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

void NearestName::Consider(std::string_view candidate) {
  // Names are short; skip a long name from a peer, whose edit distance would cost quadratic time.
  if (name_.size() > 128 || candidate.size() > 128) return;
  const size_t distance = EditDistance(name_, candidate);
  if (distance < distance_ && distance * 3 <= std::max(name_.size(), candidate.size())) {
    distance_ = distance;
    nearest_ = std::string(candidate);
  }
}

Status UnknownNameOf(std::string_view kind, std::string_view name, std::string_view known_list,
                     const NearestName& nearest) {
  std::string message = fmt::format("unknown {} '{}'", kind, name.substr(0, 100));
  if (nearest.nearest()) message += fmt::format("; did you mean '{}'?", *nearest.nearest());
  message += fmt::format(" known: {}", known_list.empty() ? "none" : known_list);
  return Status(StatusCode::kUnknownName, message);
}

}  // namespace b4mrl
