// The paper's figures, learning curves.
#include "benchmarks/pages/figures.h"
#include "benchmarks/pages/sections.h"

namespace b4mrl {

Section FiguresSection(const Evidence& evidence) {
  Section section;
  section.title = "The paper's figures";
  section.blocks.emplace_back(ScoresPicture(evidence));
  section.blocks.emplace_back(ConditionsPicture(evidence));
  section.blocks.emplace_back(DimensionsPicture(evidence));
  return section;
}

Section CurvesSection(const Evidence& evidence) {
  Section section;
  section.title = "Learning curves";
  if (evidence.table.runs().empty()) {
    section.blocks.emplace_back(Paragraph{"Nothing has run yet."});
  } else {
    section.blocks.emplace_back(CurvesPicture(evidence));
  }
  return section;
}

}  // namespace b4mrl
