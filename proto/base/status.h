// Status and Result: how every error that input can cause travels through the project.
//
// A Status names the refused argument, its value and the allowed values, because its reader is
// usually at the other end of a socket. The protocol has the same codes (proto/b4mrl.proto), and
// they decide the command line's exit code. Value types; no thread rule.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace b4mrl {

// The numbers are part of the protocol: never reuse or change a number.
enum class StatusCode : int32_t {
  kOk = 0,
  kInvalidArgument = 1,      // a value is malformed or outside its range
  kUnknownName = 2,          // no such environment, perturbation, dataset, session, ...
  kUnsupported = 3,          // known, but not available in this combination
  kBusy = 4,                 // the lane already executes another request
  kStale = 5,                // a step number below the lane's last one
  kGap = 6,                  // a step number beyond the lane's last one + 1
  kLimitExceeded = 7,        // a limit of proto/base/limits.h is reached at present
  kDeadlineExceeded = 8,     // the request was not executed, as its deadline passed first
  kUnavailable = 9,          // the peer cannot be reached or is draining; try again
  kVersionMismatch = 10,     // protocol versions or engine versions differ
  kSessionLost = 11,         // the session ended (lease, close) or never existed
  kDataLoss = 12,            // a file is truncated, corrupt or inconsistent
  kIoError = 13,             // the operating system refused a read or a write
  kFailedPrecondition = 14,  // the call is not allowed in the present state
  kInternal = 15,            // a bug in b4mrl
};

// The code's name, as "INVALID_ARGUMENT"; "UNKNOWN" for a number outside the enumeration.
std::string_view StatusCodeName(StatusCode code);

class [[nodiscard]] Status {
 public:
  Status() = default;  // OK
  Status(StatusCode code, std::string message) : code_(code), message_(std::move(message)) {}

  bool ok() const { return code_ == StatusCode::kOk; }
  StatusCode code() const { return code_; }
  const std::string& message() const { return message_; }
  // "INVALID_ARGUMENT: num_envs is 0, allowed: 1..1024"; "OK" when ok.
  std::string ToString() const;
  // A copy of this status with "<context>: " in front of its message.
  Status WithContext(std::string_view context) const;
  // True when the same request may succeed later, unchanged.
  bool recoverable() const;

 private:
  StatusCode code_ = StatusCode::kOk;
  std::string message_;
};

// kInvalidArgument with the message "<name> is <value>, allowed: <allowed>".
Status InvalidArgument(std::string_view name, std::string_view value, std::string_view allowed);
// InvalidArgument for a number, which may be NaN or infinite.
Status InvalidNumber(std::string_view name, double value, std::string_view allowed);
// kUnknownName with the message "unknown <kind> '<name>'; did you mean '<nearest>'? known: a, b,
// c". `known` may be any range of strings.
template <typename Range>
Status UnknownName(std::string_view kind, std::string_view name, const Range& known);
// kIoError with the message "cannot <action> <path>: <strerror(error_number)>".
Status IoError(std::string_view action, std::string_view path, int error_number);
// Whether `status` is an IoError with this error number, also from another process.
bool IsIoErrorOf(const Status& status, int error_number);

// Finds among candidates the string with the smallest edit distance to `name`, if the distance is
// at most a third of the longer string's length. A folder that both begin with counts for neither,
// as it would make any two names in "HalfCheetah/" resemble each other; nor does a version, "-v0",
// of a candidate where `name` has none.
class NearestName {
 public:
  explicit NearestName(std::string_view name) : name_(name) {}
  void Consider(std::string_view candidate);
  const std::optional<std::string>& nearest() const { return nearest_; }

 private:
  std::string name_;
  std::optional<std::string> nearest_;
  size_t distance_ = SIZE_MAX;
};
Status UnknownNameOf(std::string_view kind, std::string_view name, std::string_view known_list,
                     const NearestName& nearest);

template <typename Range>
Status UnknownName(std::string_view kind, std::string_view name, const Range& known) {
  NearestName nearest(name);
  std::string list;
  for (const auto& entry : known) {
    nearest.Consider(entry);
    list += list.empty() ? "" : ", ";
    list += entry;
  }
  return UnknownNameOf(kind, name, list, nearest);
}

// A value, or the Status that says why there is no value. Calling value() without ok() is a
// programming error and ends the process.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : value_(std::move(value)) {}          // NOLINT: implicit by design
  Result(Status status) : status_(std::move(status)) {}  // NOLINT: implicit by design

  bool ok() const { return value_.has_value(); }
  const Status& status() const { return status_; }
  T& value() & { return value_.value(); }
  const T& value() const& { return value_.value(); }
  // Returns by value, so that a loop over the value of a temporary Result does not dangle.
  T value() && { return std::move(value_).value(); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

 private:
  Status status_;
  std::optional<T> value_;
};

}  // namespace b4mrl

// Returns the Status of `expression` from the enclosing function unless it is OK.
#define B4MRL_RETURN_IF_ERROR(expression)                                                     \
  do {                                                                                        \
    if (::b4mrl::Status b4mrl_status = (expression); !b4mrl_status.ok()) return b4mrl_status; \
  } while (false)

#define B4MRL_CONCAT_INNER(a, b) a##b
#define B4MRL_CONCAT(a, b) B4MRL_CONCAT_INNER(a, b)
// B4MRL_ASSIGN_OR_RETURN(auto x, Compute()) assigns the value of the Result Compute() to x, or
// returns its Status from the enclosing function.
#define B4MRL_ASSIGN_OR_RETURN(lhs, expression) \
  B4MRL_ASSIGN_OR_RETURN_INNER(B4MRL_CONCAT(b4mrl_result_, __LINE__), lhs, expression)
#define B4MRL_ASSIGN_OR_RETURN_INNER(result, lhs, expression) \
  auto result = (expression);                                 \
  if (!result.ok()) return result.status();                   \
  lhs = std::move(result).value()
