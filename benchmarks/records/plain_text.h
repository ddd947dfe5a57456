// Texts of files that others may have written, as terminals and tables can show them: a control
// character could forge a line or move a terminal's cursor. Pure functions; any thread.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace b4mrl {

// With U+FFFD in the place of each control character, line ends and those of C1 among them, and of
// each byte that is no UTF-8.
std::string WithoutControls(std::string_view text);
// The same for every text in a value; names of entries stay as they are.
void ReplaceControls(nlohmann::ordered_json* json);
// The same, cut where it is longer than a few lines.
std::string OnOneLine(std::string_view text);

}  // namespace b4mrl
