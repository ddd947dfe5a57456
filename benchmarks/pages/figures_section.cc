// The paper's figures, learning curves.
#include <utility>

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
    return section;
  }
  section.blocks.emplace_back(Paragraph{
      "Scores after each evaluation; with several seeds their mean, and a band of one deviation. "
      "Runs that are over four times as long as the shortest beside them have a panel of their "
      "own; beside the shorter ones a dashed line shows where they end. Panels whose runs are all "
      "shown by another one are left out. MOPO and HyMOPO learn their models before the first "
      "update."});
  for (Picture& picture : CurvesPictures(evidence)) section.blocks.emplace_back(std::move(picture));
  return section;
}

}  // namespace b4mrl
