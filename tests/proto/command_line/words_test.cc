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

TEST_CASE("An address is one to which a client can connect") {
  for (const char* text : {"tcp://127.0.0.1:7700", "tcp://host.example-1:65535",
                           "ipc:///run/b4mrl.sock", "ipc://socket"}) {
    CAPTURE(text);
    CHECK(CheckAddress(text).ok());
  }
  for (const char* text : {"", "foo", "127.0.0.1:7811", "tcp://host", "tcp://host:0",
                           "tcp://*:7700", "tcp://a host:7700", "tcp://[::1]:7700",
                           "tcp://::1:7700", "tcp://host:65536", "udp://host:1", "ipc://"}) {
    CAPTURE(text);
    const Status refused = CheckAddress(text);
    CHECK(refused.code() == StatusCode::kInvalidArgument);
    std::string value = text;
    CHECK(Address()(value) == refused.message());
    CHECK(refused.message().find("'" + value + "', allowed: ") != std::string::npos);
  }
}

TEST_CASE("Words that an application knows let its program go on") {
  CLI::App app("An application.", "program");
  CLI::App* group = app.add_subcommand("group");
  std::string value, other;
  CLI::App* command = group->add_subcommand("command");
  command->add_option("--name", value);
  command->add_option("--other", other);
  CHECK(ParseWords(app, {"group", "command", "--name", "x"}) == std::nullopt);
  CHECK(value == "x");
  CHECK(ParseWords(app, {"group", "command", "--name=x=", "--other=y"}) == std::nullopt);
  CHECK(value == "x=");
  CHECK(ParseWords(app, {"group", "command", "--name=", "--other=y"}) == std::nullopt);
  CHECK(value.empty());
  CHECK(other == "y");
  CHECK(ParseWords(app, {"group", "comand"}) == 2);
  CHECK(ParseWords(app, {"group", "command", "--nam", "x"}) == 2);
  CHECK(ParseWords(app, {"group", "command", "surplus"}) == 2);
}

}  // namespace
}  // namespace b4mrl
