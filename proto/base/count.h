// Counts and seeds as people write them on a command line: 250000, 1e6, 2.5e5. Any thread.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "proto/base/status.h"

namespace b4mrl {

// Parses a whole number exactly: digits, optionally with a decimal point and an exponent, as long
// as the value is whole. kInvalidArgument for other texts (signs, 1.5, words) and for numbers
// outside low..high; the message has the value and the range, not the option's name.
Result<uint64_t> ParseCount(std::string_view text, uint64_t low, uint64_t high);

// ParseCount for CLI11: CLI::Validator(CountText(1, 100), "") replaces the option's text by plain
// digits, or returns the error's message.
std::function<std::string(std::string&)> CountText(uint64_t low, uint64_t high);

}  // namespace b4mrl
