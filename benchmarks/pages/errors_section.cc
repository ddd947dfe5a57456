// The paper's table of errors, with our perturbations beside it.
#include "benchmarks/pages/sections.h"

namespace b4mrl {

Section ErrorsSection(const Evidence& evidence) {
  Table table;
  table.id = "errors";
  table.title = "What is wrong in which environment.";
  table.caption =
      "The paper's table sim2real. The same noise and the same hidden dimensions corrupt data, "
      "where a benchmark says so.";
  table.columns = {
      {"Environment"}, {"Error"}, {"Perturbation"}, {"The paper's parameter"}, {"Its value"}};
  table.rows = evidence.parameters;
  Section section;
  section.title = "The errors";
  section.blocks.emplace_back(std::move(table));
  return section;
}

}  // namespace b4mrl
