// The lines of small CSV files without quotes, as this project writes them. Pure functions, whose
// results point into their arguments.
#pragma once

#include <optional>
#include <string_view>
#include <vector>

namespace b4mrl {

// The lines of a text without their ends, "\n". Behind the last end stands a line only if there is
// text.
std::vector<std::string_view> LinesOf(std::string_view text);
// The cells of a line, which has no end of line.
std::vector<std::string_view> CellsOf(std::string_view line);
// A cell that is a number as a whole; none if it is anything else, or empty.
std::optional<double> NumberOf(std::string_view cell);

}  // namespace b4mrl
