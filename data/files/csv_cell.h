// Text as a cell of CSV (RFC 4180). Pure functions; any thread.
#pragma once

#include <string>

namespace b4mrl {

// In quotes where it has a comma, a quote or a line's end; as it is otherwise.
std::string CsvCell(const std::string& text);

}  // namespace b4mrl
