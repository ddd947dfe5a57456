#include "server/environments/config.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>

#include "proto/base/limits.h"
#include "proto/wire/json_depth.h"

namespace b4mrl {
namespace {

constexpr int kMaxDepth = 8;
constexpr size_t kShownBytes = 100;  // of a refused text, in its error message

// Finds where a text stops being JSON: nlohmann::json tells the place to a SAX handler only.
struct ErrorFinder final : nlohmann::json_sax<Config> {
  size_t position = 0;  // of the error in the text: bytes, from 1
  std::string near;     // the last token read

  bool null() override { return true; }
  bool boolean(bool) override { return true; }
  bool number_integer(number_integer_t) override { return true; }
  bool number_unsigned(number_unsigned_t) override { return true; }
  bool number_float(number_float_t, const string_t&) override { return true; }
  bool string(string_t&) override { return true; }
  bool binary(binary_t&) override { return true; }
  bool start_object(size_t) override { return true; }
  bool key(string_t&) override { return true; }
  bool end_object() override { return true; }
  bool start_array(size_t) override { return true; }
  bool end_array() override { return true; }
  bool parse_error(size_t at, const std::string& token, const Config::exception&) override {
    position = at;
    near = token;
    return false;
  }
};

}  // namespace

Result<Config> ParseConfig(std::string_view text) {
  if (text.empty()) return Config::object();
  if (text.size() > limits::kMaxOpenRequestBytes) {
    return InvalidNumber("bytes of config", static_cast<double>(text.size()),
                         fmt::format("at most {}", limits::kMaxOpenRequestBytes));
  }
  if (NestsDeeper(text, kMaxDepth)) {
    return InvalidArgument("depth of config", "more", std::to_string(kMaxDepth));
  }
  Config config = Config::parse(text, nullptr, /*allow_exceptions=*/false);
  if (config.is_discarded()) {
    ErrorFinder finder;
    Config::sax_parse(text, &finder);
    return Status(StatusCode::kInvalidArgument,
                  fmt::format("config is not valid JSON at byte {} ('{}')", finder.position,
                              finder.near.substr(0, kShownBytes)));
  }
  if (!config.is_object()) {
    return Status(StatusCode::kInvalidArgument, "config is not a JSON object");
  }
  return config;
}

}  // namespace b4mrl
