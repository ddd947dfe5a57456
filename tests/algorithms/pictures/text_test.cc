#include "algorithms/pictures/text.h"

#include <tinyxml2.h>

#include <catch2/catch.hpp>
#include <string>
#include <vector>

namespace b4mrl {
namespace {

TEST_CASE("A reader of XML gets escaped text back as it was") {
  const std::string text = "a<b> & \"c\" 'd' ]]> \xC2\xB5m \xE2\x88\x92 \xF0\x9F\x98\x80";
  const std::string xml = "<t a=\"" + EscapeXml(text) + "\">" + EscapeXml(text) + "</t>";
  tinyxml2::XMLDocument document;
  REQUIRE(document.Parse(xml.c_str()) == tinyxml2::XML_SUCCESS);
  CHECK(document.RootElement()->GetText() == text);
  CHECK(document.RootElement()->Attribute("a") == text);
}

TEST_CASE("Bytes that XML forbids become the replacement character") {
  const std::string replaced = "\xEF\xBF\xBD";
  CHECK(EscapeXml(std::string("a\0b\x1F\x7F", 5)) == "a" + replaced + "b" + replaced + replaced);
  CHECK(EscapeXml("\xC0\x80") == replaced + replaced);                 // overlong
  CHECK(EscapeXml("\xED\xA0\x80") == replaced + replaced + replaced);  // a surrogate
  CHECK(EscapeXml("\xEF\xBF\xBF") == replaced + replaced + replaced);  // no character
  CHECK(EscapeXml("x\xE2\x88") == "x" + replaced + replaced);          // cut off
  CHECK(EscapeXml("\xF8z") == replaced + "z");
}

TEST_CASE("Numbers have commas between thousands, whatever their sign") {
  CHECK(FormatFixed(1234567, 0) == "1,234,567");
  CHECK(FormatFixed(-123, 0) == "-123");
  CHECK(FormatFixed(-1234.56, 1) == "-1,234.6");
  CHECK(FormatFixed(-0.04, 1) == "0.0");
  CHECK(FormatNumber(4767.234) == "4,767.23");
  CHECK(FormatNumber(-0.0) == "0");
  CHECK(FormatNumber(1e30) == "1e+30");
}

TEST_CASE("Text is wrapped into lines that fit, and no letter is lost") {
  CHECK(WrapText("", 10, 100).empty());
  CHECK(WrapText("one two", 10, 1000) == std::vector<std::string>{"one two"});
  const std::string text = "a few words and-one-word-that-is-longer-than-any-line";
  std::string together;
  for (const std::string& line : WrapText(text, 10, 90)) {
    INFO(line);
    CHECK(TextWidth(line, 10) <= 90);
    together += line;
  }
  std::erase(together, ' ');
  CHECK(together == "afewwordsand-one-word-that-is-longer-than-any-line");
  // A single letter is never broken, however narrow the line.
  CHECK(WrapText("ab", 10, 1) == std::vector<std::string>{"a", "b"});
}

}  // namespace
}  // namespace b4mrl
