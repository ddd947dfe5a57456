#include "data/files/csv_lines.h"

#include <catch2/catch.hpp>
#include <string_view>
#include <vector>

namespace b4mrl {
namespace {

using Texts = std::vector<std::string_view>;

TEST_CASE("A text's lines are those between its line ends, empty ones included") {
  CHECK(LinesOf("").empty());
  CHECK(LinesOf("a\n") == Texts{"a"});
  CHECK(LinesOf("a\nb") == Texts{"a", "b"});
  CHECK(LinesOf("a\n\nb\n") == Texts{"a", "", "b"});
  CHECK(LinesOf("\n") == Texts{""});
}

TEST_CASE("A line's cells stand between commas, empty ones included") {
  CHECK(CellsOf("") == Texts{""});
  CHECK(CellsOf("a") == Texts{"a"});
  CHECK(CellsOf("a,,b,") == Texts{"a", "", "b", ""});
}

TEST_CASE("Only a cell that is a number from its first to its last character is a number") {
  CHECK(NumberOf("1.5") == 1.5);
  CHECK(NumberOf("-2e3") == -2000);
  for (const std::string_view cell : {"", "-", "1.5 ", " 1", "1,5", "a"}) {
    CAPTURE(cell);
    CHECK_FALSE(NumberOf(cell));
  }
}

}  // namespace
}  // namespace b4mrl
