#include "data/minari/minari_id.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>

namespace b4mrl {
namespace {

constexpr std::string_view kAllowed =
    "parts of letters, digits, '-' and '_', none of them \"data\", joined by '/', with a version "
    "at "
    "the end: \"b4mrl/HalfCheetah/medium-v0\"";

bool IsIdCharacter(unsigned char c) {
  return c < 128 && (std::isalnum(c) != 0 || c == '-' || c == '_');
}

// The length of a version at the end of `name`, "-v0"; 0 if there is none or nothing before it.
size_t VersionLength(std::string_view name) {
  const size_t digits = name.size() - (name.find_last_not_of("0123456789") + 1);
  const size_t length = digits + 2;
  if (digits == 0 || digits > 9 || length >= name.size()) return 0;
  return name.substr(name.size() - length, 2) == "-v" ? length : 0;
}

std::string InIdCharacters(std::string_view text) {
  std::string out(text);
  for (char& c : out) {
    if (c == '.') c = 'p';
    if (!IsIdCharacter(static_cast<unsigned char>(c))) c = '_';
  }
  return out;
}

}  // namespace

Status CheckMinariId(std::string_view id) {
  std::string_view rest = id;
  while (true) {
    const size_t slash = std::min(rest.find('/'), rest.size());
    const std::string_view part = rest.substr(0, slash);
    const bool last = slash == rest.size();
    if (part.empty() || part == "data" || !std::ranges::all_of(part, IsIdCharacter) ||
        (last && VersionLength(part) == 0)) {
      return InvalidArgument("Minari's dataset id", id, kAllowed);
    }
    if (last) return Status();
    rest.remove_prefix(slash + 1);
  }
}

std::vector<std::string> MinariNamespaces(std::string_view id) {
  std::vector<std::string> namespaces;
  for (size_t slash = id.find('/'); slash != id.npos; slash = id.find('/', slash + 1)) {
    namespaces.emplace_back(id.substr(0, slash));
  }
  return namespaces;
}

std::string MinariIdOf(const ServedRows& rows) {
  const size_t version = VersionLength(rows.name);
  std::string id = "b4mrl/" + rows.name.substr(0, rows.name.size() - version);
  for (const NamedArgument& corruption : rows.corruptions) {
    id += "_" + corruption.name;
    if (!corruption.argument.empty()) id += "-" + InIdCharacters(corruption.argument);
  }
  if (rows.corruption_seed != 0) id += fmt::format("_seed-{}", rows.corruption_seed);
  if (rows.d4rl_transitions) id += "_d4rl-transitions";
  return id + (version == 0 ? "-v0" : rows.name.substr(rows.name.size() - version));
}

}  // namespace b4mrl
