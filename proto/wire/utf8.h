// The characters of UTF-8, which Protocol Buffers demands of strings and XML of texts. Pure
// function; any thread.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

namespace b4mrl {

struct Utf8Character {
  size_t bytes = 0;  // 0: the text begins with no character of UTF-8
  uint32_t code = 0;
};
// The first character of a text that is not empty. Refuses what could be written shorter,
// surrogates, numbers beyond U+10FFFF and what is cut.
Utf8Character FirstUtf8Character(std::string_view text);

}  // namespace b4mrl
