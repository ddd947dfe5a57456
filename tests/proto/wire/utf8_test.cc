#include "proto/wire/utf8.h"

#include <catch2/catch.hpp>
#include <string_view>

namespace b4mrl {
namespace {

TEST_CASE("A text begins with a character of one to four bytes") {
  const auto is = [](std::string_view text, size_t bytes, uint32_t code) {
    const Utf8Character first = FirstUtf8Character(text);
    return first.bytes == bytes && first.code == code;
  };
  CHECK(is("a\xc3\xa9", 1, 'a'));
  CHECK(is("\xc3\xa9x", 2, 0xe9));
  CHECK(is("\xe2\x82\xac", 3, 0x20ac));
  CHECK(is("\xef\xbf\xbf", 3, 0xffff));
  CHECK(is("\xf0\x9f\x98\x80", 4, 0x1f600));
  CHECK(is("\xf4\x8f\xbf\xbf", 4, 0x10ffff));
}

TEST_CASE("What is cut, misplaced, longer than needed or no character is refused") {
  for (const std::string_view text :
       {"\xc3", "\xe2\x82", "\xf0\x9f\x98", "\xa9", "\xc3x", "\xe2\x82x", "\xc0\xaf", "\xc1\xbf",
        "\xe0\x9f\xbf", "\xf0\x8f\xbf\xbf", "\xed\xa0\x80", "\xed\xbf\xbf", "\xf4\x90\x80\x80",
        "\xf5\x80\x80\x80", "\xff"}) {
    CHECK(FirstUtf8Character(text).bytes == 0);
  }
}

}  // namespace
}  // namespace b4mrl
