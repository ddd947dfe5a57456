// Refuses JSON that nests lists and objects without limit, as text of a peer, a file or another
// process may: copies, comparisons and writers of what was read recurse, so that a few kilobytes of
// brackets could overflow the stack. Also tells of objects that are too large for a reader whose
// time grows with the square of their entries. Pure functions; any thread.
#pragma once

#include <cstddef>
#include <string_view>

namespace b4mrl {

// Whether a text has more than `most` lists and objects inside each other. Exact for valid JSON; in
// time linear in the text, unlike a parser's callback, which searches a list for every object in
// it.
bool NestsDeeper(std::string_view json, int most);

// Whether an object has more than `most` entries. Exact for valid JSON; in time linear in the text,
// with a count for each list and object inside each other.
bool HasLargerObject(std::string_view json, size_t most);

// What a text holds, in the caller's kind of nlohmann::json; discarded if it is no JSON or nests
// deeper than `most`.
template <typename Json>
Json ParseShallow(std::string_view text, int most) {
  if (NestsDeeper(text, most)) return Json(Json::value_t::discarded);
  return Json::parse(text, nullptr, /*allow_exceptions=*/false);
}

}  // namespace b4mrl
