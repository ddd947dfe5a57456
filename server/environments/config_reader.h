// Reads an environment's settings with their types and bounds. Belongs to one thread.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "proto/base/status.h"
#include "server/environments/config.h"

namespace b4mrl {

// An open interval: the numbers strictly between `low` and `high`, which may be infinite.
struct Interval {
  double low = 0;
  double high = 0;

  bool Contains(double x) const { return low < x && x < high; }
};

// Whether an end of a range may be open.
enum class RangeEnds { kMayBeOpen, kFinite };

// Reads settings one by one and keeps the first error; Finish then refuses the keys that were not
// read.
//   ConfigReader reader(config);
//   const double scale = reader.Number("reset_noise_scale", 0.1, 0, 10);
//   B4MRL_RETURN_IF_ERROR(reader.Finish());
class ConfigReader {
 public:
  explicit ConfigReader(const Config& config) : config_(config) {}

  // The value of `key`, or `fallback` where it is absent. A wrong type or a value outside [low,
  // high] is an error and yields `fallback`.
  double Number(const std::string& key, double fallback, double low, double high);
  uint64_t Integer(const std::string& key, uint64_t fallback, uint64_t low, uint64_t high);
  bool Bool(const std::string& key, bool fallback);
  // Two numbers [low, high]; null is an open end, because JSON has no infinity.
  Interval Range(const std::string& key, Interval fallback, RangeEnds ends = RangeEnds::kMayBeOpen);
  // The text of `key`, one of `allowed`; allowed[0] where `key` is absent.
  std::string Choice(const std::string& key, const std::vector<std::string>& allowed);

  // For values of other types. Find: the JSON value of `key`, or nullptr where it is absent. Keep:
  // stores the completed value of `key`. Fail: reports why a value is refused.
  const Config* Find(const std::string& key);
  void Keep(const std::string& key, Config value) { completed_[key] = std::move(value); }
  void Fail(Status status);

  // Every value read so far, defaults included.
  const Config& completed() const { return completed_; }
  // The first error, an unknown key (with the nearest known one), or OK.
  Status Finish() const;

 private:
  const Config& config_;
  Config completed_ = Config::object();
  Status first_error_;
};

}  // namespace b4mrl
