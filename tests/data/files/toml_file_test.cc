// TOML files: what is refused before toml++ sees it.
#include "data/files/toml_file.h"

#include <catch2/catch.hpp>
#include <string>

#include "tests/results.h"

namespace b4mrl {
namespace {

// "a.a.a", with so many parts.
std::string KeyOf(int parts, const std::string& part = "a") {
  std::string key = part;
  for (int i = 1; i < parts; ++i) key += "." + part;
  return key;
}

TEST_CASE("A key of more than 16 parts is refused by its line, however it is written") {
  for (const std::string& text :
       {"\n" + KeyOf(17) + " = 1", "\n[" + KeyOf(17) + "]", "\n" + KeyOf(17, "\",\"") + " = 1",
        "\n" + KeyOf(17, " ',' ") + " = 1", "# \"\n" + KeyOf(17) + " = 1",
        "a = \"\\\"\"\n" + KeyOf(17) + " = 1", "a = '\\'\n" + KeyOf(17) + " = 1",
        "a = [\"\"\"x\"\"\"\", '''y''''']\n" + KeyOf(17) + " = 1",
        "\na = { " + KeyOf(17) + " = 1 }", "\n" + KeyOf(400'000) + " = 1"}) {
    CAPTURE(text.substr(0, 60));
    const Status status = ParseToml(text, "mine.toml").status();
    CHECK(status.code() == StatusCode::kInvalidArgument);
    CHECK(status.message() == "mine.toml line 2: a key has more than 16 parts");
  }
  CHECK(Take(ParseToml(KeyOf(16) + " = 1", "")).contains("a"));
}

TEST_CASE("Dots in numbers, texts and comments are none of a key's") {
  std::string numbers = "[0.5", sentences;
  for (int i = 0; i < 50; ++i) {
    numbers += ", 0.5";
    sentences += "Once. ";
  }
  const std::string quoted = "\"" + sentences + "\"";
  const toml::table table =
      Take(ParseToml("numbers = " + numbers + "]  # " + sentences + "\ntext = " + quoted +
                         "\nlong = \"\"" + quoted + "\"\"\nliteral = '" + sentences + "'\n",
                     ""));
  CHECK(ParseToml("a = \"\"\"x\"\"\"\"\"\nb = \"\"\"" + sentences + "\"\"\"\n", "").ok());
  CHECK(table["numbers"].as_array()->size() == 51);
  CHECK(table["text"].value_or(std::string()) == sentences);
  CHECK(table["long"].value_or(std::string()) == sentences);
  CHECK(table["literal"].value_or(std::string()) == sentences);
}

}  // namespace
}  // namespace b4mrl
