#include "algorithms/pictures/figure.h"

#include <fmt/format.h>

#include <algorithm>
#include <span>

#include "algorithms/pictures/panel.h"
#include "algorithms/pictures/svg.h"
#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr double kMargin = 16;  // around the figure and between its panels
constexpr double kGap = 6;      // above the legend, and between a swatch and its name
constexpr double kTitleSize = 16, kTextSize = 12;
constexpr double kTitleHeight = 21, kLineHeight = 17;
constexpr double kSwatchWidth = 22, kSwatchHeight = 10;

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

// Draws a swatch and a name for each series, in as many lines as they need, and moves `*y` below.
void DrawLegend(const Figure& figure, double width, SvgWriter* svg, double* y) {
  if (figure.series.size() < 2) return;
  double x = 0;
  *y += kGap;
  for (size_t i = 0; i < figure.series.size(); ++i) {
    const double needed = kSwatchWidth + kGap + TextWidth(figure.series[i], kTextSize);
    if (x > 0 && x + needed > width) {
      x = 0;
      *y += kLineHeight;
    }
    const std::string path =
        fmt::format("M{} {}h{}v{}h-{}Z", SvgWriter::Number(kMargin + x), SvgWriter::Number(*y + 2),
                    kSwatchWidth, kSwatchHeight, kSwatchWidth);
    if (i == 0) svg->Path(path, "area " + SeriesClass(i));
    svg->Path(path, SeriesClass(i));
    svg->Text({kMargin + x + kSwatchWidth + kGap, *y + kTextSize}, figure.series[i],
              {.size = kTextSize});
    x += needed + kMargin;
  }
  *y += kLineHeight;
}

}  // namespace

std::string RenderSvg(const Figure& figure) {
  SvgWriter svg;
  const double grid_width =
      static_cast<double>(figure.columns) * (figure.panel_width + kMargin) - kMargin;
  double y = kMargin;
  DrawTexts(figure, grid_width, &svg, &y);
  DrawLegend(figure, grid_width, &svg, &y);
  y += kMargin / 2;
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
  std::string description;
  for (const std::string& sentence : figure.sentences) {
    description += (description.empty() ? "" : " ") + sentence;
  }
  return svg.Finish(grid_width + 2 * kMargin, y, figure.title, description);
}

}  // namespace b4mrl
