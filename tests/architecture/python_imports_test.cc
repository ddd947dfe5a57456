// Imports between the modules of the Python client. Counted are those at the top level of a module:
// imports in functions and under `if TYPE_CHECKING:` are indented, and bind no module to another's
// beginning.
#include <catch2/catch.hpp>
#include <map>
#include <regex>
#include <set>

#include "tests/architecture/source_tree.h"

namespace b4mrl {
namespace {

const std::string kRoot = "client/python/";

// Module -> modules of the package that it imports: "b4mrl.client" -> {"b4mrl.errors", ...}.
using Imports = std::map<std::string, std::set<std::string>>;

// "client/python/b4mrl/wire/arrays.py" -> "b4mrl.wire.arrays"
std::string ModuleOf(const std::string& path) {
  std::string module = path.substr(kRoot.size(), path.rfind('.') - kRoot.size());
  for (char& c : module) c = c == '/' ? '.' : c;
  return module.ends_with(".__init__") ? module.substr(0, module.rfind('.')) : module;
}

// The modules named by `from PARENT import NAMES`: each name that is a module of its own, and else
// the parent.
std::set<std::string> Imported(const std::string& parent, const std::string& names,
                               const Imports& modules) {
  static const std::regex kNoName(R"(\bas\s+\w+|#[^\n]*)");
  static const std::regex kName(R"(\w+)");
  const std::string plain = std::regex_replace(names, kNoName, "");
  std::set<std::string> imported;
  for (std::sregex_iterator it(plain.begin(), plain.end(), kName), end; it != end; ++it) {
    const std::string module = parent + "." + it->str();
    imported.insert(modules.contains(module) ? module : parent);
  }
  return imported;
}

Imports ReadImports() {
  static const std::regex kFrom(R"(\nfrom (b4mrl[\w.]*) import (\([^)]*\)|[^\n]*))");
  static const std::regex kImport(R"(\nimport (b4mrl[\w.]*))");
  static const std::regex kRelative(R"(\n\s*from \.)");
  Imports imports;
  const std::vector<SourceFile> files = ReadTree({".py"});
  for (const SourceFile& file : files) {
    if (file.In(kRoot)) imports[ModuleOf(file.path)];
  }
  for (const SourceFile& file : files) {
    if (!file.In(kRoot)) continue;
    const std::string text = "\n" + file.text();
    INFO(file.path << " imports by a relative name, which is not read here");
    CHECK_FALSE(std::regex_search(text, kRelative));
    std::set<std::string>& found = imports[ModuleOf(file.path)];
    for (std::sregex_iterator it(text.begin(), text.end(), kFrom), end; it != end; ++it) {
      found.merge(Imported((*it)[1], (*it)[2], imports));
    }
    for (std::sregex_iterator it(text.begin(), text.end(), kImport), end; it != end; ++it) {
      found.insert((*it)[1]);
    }
  }
  return imports;
}

// Whether imports lead from `from` to `module`, directly or over others.
bool LeadsTo(const Imports& imports, const std::string& from, const std::string& module,
             std::set<std::string>& visited) {
  INFO(from << " imports what is no module of the package");
  REQUIRE(imports.contains(from));
  for (const std::string& next : imports.at(from)) {
    if (next == module) return true;
    if (visited.insert(next).second && LeadsTo(imports, next, module, visited)) return true;
  }
  return false;
}

TEST_CASE("No imports between modules of the Python client make a circle") {
  const Imports imports = ReadImports();
  CHECK(imports.at("b4mrl").contains("b4mrl.client"));  // the expressions above still match
  for (const auto& [module, others] : imports) {
    std::set<std::string> visited;
    INFO(module);
    CHECK_FALSE(LeadsTo(imports, module, module, visited));
  }
}

TEST_CASE("The Python client's wire/ imports nothing of the layer above") {
  const Imports imports = ReadImports();
  CHECK(imports.at("b4mrl.wire.session").contains("b4mrl.wire.connection"));
  CHECK(imports.at("b4mrl.errors").empty());  // below both: what wire/ may raise and users catch
  for (const auto& [module, others] : imports) {
    if (!module.starts_with("b4mrl.wire")) continue;
    for (const std::string& other : others) {
      INFO(module << " imports " << other);
      CHECK((other.starts_with("b4mrl.wire.") || other == "b4mrl.errors"));
    }
  }
}

}  // namespace
}  // namespace b4mrl
