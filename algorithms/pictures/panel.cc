#include "algorithms/pictures/panel.h"

#include <algorithm>

#include "algorithms/pictures/marks.h"
#include "algorithms/pictures/text.h"
#include "algorithms/pictures/tick_labels.h"

namespace b4mrl {
namespace {

constexpr double kTitleSize = 12, kTextSize = 11;
constexpr double kLineHeight = 14;
constexpr double kTickLength = 4;
constexpr double kGap = 6;          // between neighbouring things
constexpr double kTextGap = 10;     // between a panel's texts and its plot
constexpr double kMostNames = 0.4;  // of a panel's width, for the names of places beside its plot

using Anchor = TextStyle::Anchor;

std::vector<std::string> TitleLines(const Panel& panel, double width) {
  return WrapText(panel.title, kTitleSize * kBoldWidening, width);
}

std::vector<std::string> NoteLines(const Panel& panel, double width) {
  std::vector<std::string> lines;
  for (const std::string& note : panel.notes) {
    for (std::string& line : WrapText(note, kTextSize, width)) lines.push_back(std::move(line));
  }
  return lines;
}

std::vector<std::string> AxisLines(const Axis& axis, double length) {
  return WrapText(axis.Title(), kTextSize, length);
}

// The height of a horizontal axis with its ticks, their labels and its title.
double AxisHeight(const Axis& axis, double length) {
  const auto lines = static_cast<double>(AxisLines(axis, length).size());
  return LabelsBelow(axis, length).extent + lines * kLineHeight + kGap;
}

double MostNames(const Figure& figure) { return kMostNames * figure.panel_width; }

// The height of all plots of the figure.
double PlotHeight(const Figure& figure) {
  double height = figure.plot_height;
  for (const Panel& panel : figure.panels) {
    if (panel.marks.empty()) continue;
    height = std::max(height, LeastHeight(panel.y, MostNames(figure)));
  }
  return height;
}

// Texts below each other; `baseline` is the first one's.
void DrawLines(const std::vector<std::string>& lines, Point baseline, double distance,
               const TextStyle& style, SvgWriter* svg) {
  for (const std::string& line : lines) {
    svg->Text(baseline, line, style);
    (style.upwards ? baseline.x : baseline.y) += distance;
  }
}

// From the middle of lines of labels to the baseline of the first one.
double MiddleToBaseline(const std::vector<std::string>& lines) {
  return 0.35 * kTickSize - 0.5 * (static_cast<double>(lines.size()) - 1) * kTickLineHeight;
}

void DrawYAxis(const Plot& plot, double panel_left, double most_names) {
  for (const TickLabel& label :
       LabelsBeside(plot.panel.y, plot.bottom - plot.top, most_names).labels) {
    const double y = plot.y.At(label.value);
    plot.svg->Line({plot.left, y}, {plot.right, y}, "grid");
    plot.svg->Line({plot.left - kTickLength, y}, {plot.left, y}, "frame");
    DrawLines(label.lines, {plot.left - kGap, y + MiddleToBaseline(label.lines)}, kTickLineHeight,
              {.size = kTickSize, .anchor = Anchor::kEnd}, plot.svg);
  }
  DrawLines(AxisLines(plot.panel.y, plot.bottom - plot.top),
            {panel_left + kLineHeight, (plot.top + plot.bottom) / 2}, kLineHeight,
            {.size = kTextSize, .anchor = Anchor::kMiddle, .upwards = true}, plot.svg);
}

// The axis below the plot or above it; `away` is 1 or -1, the direction from the plot to its texts.
void DrawXAxis(const Plot& plot, const Axis& axis, double y, double away) {
  const Scale scale{axis.low, axis.high, plot.left, plot.right};
  const double length = plot.right - plot.left;
  plot.svg->Line({plot.left, y}, {plot.right, y}, "frame");
  const double ascent = away > 0 ? 0.8 * kTickSize : 0;
  const TickLabels ticks = LabelsBelow(axis, length);
  for (const TickLabel& label : ticks.labels) {
    const double x = scale.At(label.value);
    plot.svg->Line({x, y}, {x, y + away * kTickLength}, "frame");
    const Point baseline = ticks.upwards ? Point{x + MiddleToBaseline(label.lines), y + kGap}
                                         : Point{x, y + away * kGap + ascent};
    DrawLines(label.lines, baseline, kTickLineHeight,
              {.size = kTickSize,
               .anchor = ticks.upwards ? Anchor::kEnd : Anchor::kMiddle,
               .upwards = ticks.upwards},
              plot.svg);
  }
  const std::vector<std::string> lines = AxisLines(axis, length);
  const double first = away > 0 ? 0 : -(static_cast<double>(lines.size()) - 1) * kLineHeight;
  DrawLines(lines,
            {(plot.left + plot.right) / 2, y + away * (kGap + ticks.extent) + ascent + first},
            kLineHeight, {.size = kTextSize, .anchor = Anchor::kMiddle}, plot.svg);
}

// Lines at the values of x, where it is x that values are read from.
void DrawXGrid(const Plot& plot) {
  if (plot.panel.y.places.empty()) return;
  for (const TickLabel& label : LabelsBelow(plot.panel.x, plot.right - plot.left).labels) {
    const double x = plot.x.At(label.value);
    plot.svg->Line({x, plot.top}, {x, plot.bottom}, "grid");
  }
}

}  // namespace

PanelLayout LayoutOf(const Figure& figure, std::span<const Panel> row) {
  const double height = PlotHeight(figure);
  size_t y_lines = 0;
  double label_width = 0;
  for (const Panel& panel : figure.panels) {
    if (panel.marks.empty()) continue;
    y_lines = std::max(y_lines, AxisLines(panel.y, height).size());
    label_width = std::max(label_width, LabelsBeside(panel.y, height, MostNames(figure)).extent);
  }
  PanelLayout layout;
  layout.width = figure.panel_width;
  layout.plot_left = static_cast<double>(y_lines) * kLineHeight + 2 * kGap + label_width;
  layout.plot_right = figure.panel_width - kRightMargin;
  layout.most_names = MostNames(figure);

  const double plot_width = layout.plot_right - layout.plot_left;
  size_t texts = 0;
  double above = 0, plot = 0, below = 0;  // heights of axes' texts, and of the plot between them
  for (const Panel& panel : row) {
    texts = std::max(texts, TitleLines(panel, figure.panel_width).size() +
                                NoteLines(panel, figure.panel_width).size());
    if (panel.marks.empty()) continue;
    plot = height;
    below = std::max(below, AxisHeight(panel.x, plot_width));
    if (panel.upper_x) above = std::max(above, AxisHeight(*panel.upper_x, plot_width));
  }
  layout.plot_top = static_cast<double>(texts) * kLineHeight + kTextGap + above;
  layout.plot_bottom = layout.plot_top + plot;
  layout.height = layout.plot_bottom + below;
  return layout;
}

void DrawPanel(const Panel& panel, const PanelLayout& layout, Point corner, SvgWriter* svg) {
  double baseline = corner.y;
  for (const std::string& line : TitleLines(panel, layout.width)) {
    svg->Text({corner.x, baseline += kLineHeight}, line, {.size = kTitleSize, .bold = true});
  }
  for (const std::string& line : NoteLines(panel, layout.width)) {
    svg->Text({corner.x, baseline += kLineHeight}, line, {.size = kTextSize});
  }
  if (panel.marks.empty()) return;
  const double left = corner.x + layout.plot_left, right = corner.x + layout.plot_right;
  const double top = corner.y + layout.plot_top, bottom = corner.y + layout.plot_bottom;
  const Plot plot{panel,
                  left,
                  right,
                  top,
                  bottom,
                  {panel.x.low, panel.x.high, left, right},
                  panel.y.places.empty() ? Scale{panel.y.low, panel.y.high, bottom, top}
                                         : Scale{panel.y.low, panel.y.high, top, bottom},
                  svg};
  DrawXGrid(plot);
  DrawYAxis(plot, corner.x, layout.most_names);
  for (const Mark& mark : panel.marks) DrawMark(plot, mark);
  DrawXAxis(plot, panel.x, bottom, 1);
  if (panel.upper_x) DrawXAxis(plot, *panel.upper_x, top, -1);
}

}  // namespace b4mrl
