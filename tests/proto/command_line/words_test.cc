// How programs read their command lines: what they accept, and where they go on.
#include "proto/command_line/words.h"

#include <catch2/catch.hpp>
#include <optional>
#include <string>

namespace b4mrl {
namespace {

TEST_CASE("A number is accepted with its bounds, and no word or NaN is one") {
  const CLI::Validator number = Number(0.5, 60);
  for (const char* text : {"0.5", "60", "1e1"}) {
    std::string value = text;
    CHECK(number(value).empty());
  }
  for (const char* text : {"0.4", "60.1", "nan", "-nan", "inf", "", "five", "1x"}) {
    INFO(text);
    std::string value = text;
    CHECK(number(value) == std::string(text) + " is not a number in 0.5..60");
  }
}

TEST_CASE("Words that an application knows let its program go on") {
  CLI::App app("An application.", "program");
  CLI::App* group = app.add_subcommand("group");
  std::string value;
  group->add_subcommand("command")->add_option("--name", value);
  CHECK(ParseWords(app, {"group", "command", "--name", "x"}) == std::nullopt);
  CHECK(value == "x");
  CHECK(ParseWords(app, {"group", "comand"}) == 2);
  CHECK(ParseWords(app, {"group", "command", "--nam", "x"}) == 2);
  CHECK(ParseWords(app, {"group", "command", "surplus"}) == 2);
}

}  // namespace
}  // namespace b4mrl
