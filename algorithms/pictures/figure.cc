#include "algorithms/pictures/figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

#include "algorithms/pictures/legend.h"
#include "algorithms/pictures/panel.h"
#include "algorithms/pictures/svg.h"
#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr double kMargin = 16;  // around the figure and between its panels
constexpr double kTitleSize = 16, kTextSize = 12;
constexpr double kTitleHeight = 21, kLineHeight = 17;

// Draws the title and the sentences, and moves `*y` below them.
void DrawTexts(const Figure& figure, double width, SvgWriter* svg, double* y) {
  for (const std::string& line : WrapText(figure.title, kTitleSize * kBoldWidening, width)) {
    svg->Text({kMargin, *y + kTitleSize}, line, {.size = kTitleSize, .bold = true});
    *y += kTitleHeight;
  }
  for (const std::string& sentence : figure.sentences) {
    for (const std::string& line : WrapText(sentence, kTextSize, width)) {
      svg->Text({kMargin, *y + kTextSize}, line, {.size = kTextSize});
      *y += kLineHeight;
    }
  }
}

}  // namespace

std::string RenderSvg(const Figure& figure) {
  SvgWriter svg;
  const double grid_width =
      static_cast<double>(figure.columns) * (figure.panel_width + kMargin) - kMargin;
  double y = kMargin;
  DrawTexts(figure, grid_width, &svg, &y);
  y += DrawLegend(figure, {kMargin, y}, grid_width, &svg) + kMargin / 2;
  const std::span<const Panel> panels = figure.panels;
  for (size_t first = 0; first < panels.size(); first += figure.columns) {
    const auto row = panels.subspan(first, std::min(figure.columns, panels.size() - first));
    const PanelLayout layout = LayoutOf(figure, row);
    double x = kMargin;
    for (const Panel& panel : row) {
      DrawPanel(panel, layout, {x, y}, &svg);
      x += layout.width + kMargin;
    }
    y += layout.height + kMargin;
  }
  const std::string description = fmt::format("{}", fmt::join(figure.sentences, " "));
  return svg.Finish(grid_width + 2 * kMargin, y, figure.title, description);
}

}  // namespace b4mrl
