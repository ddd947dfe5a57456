#include "algorithms/pictures/panel.h"

#include <algorithm>
#include <cmath>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr double kTitleSize = 12, kTextSize = 11, kTickSize = 10;
constexpr double kLineHeight = 14;
constexpr double kTickLength = 4;
constexpr double kGap = 6;           // between neighbouring things
constexpr double kRightMargin = 20;  // half of the last tick's label may stand in it
constexpr double kTextGap = 10;      // between a panel's texts and its plot
constexpr size_t kMostTicks = 7;

using Anchor = TextStyle::Anchor;

// Where the values of an axis lie, in pixels.
struct Scale {
  double low, high;   // values
  double start, end;  // their pixels
  double At(double value) const { return start + (value - low) / (high - low) * (end - start); }
};

double LabelWidth(const Tick& tick) { return TextWidth(tick.label, kTickSize); }

// As many ticks as have room for their labels beside each other; none if not even one has.
std::vector<Tick> HorizontalTicks(const Axis& axis, double width) {
  for (size_t most = kMostTicks; most > 0; --most) {
    const std::vector<Tick> ticks = Ticks(axis, most);
    const Scale scale{axis.low, axis.high, 0, width};
    bool fits = true;
    double end = -kRightMargin;
    for (const Tick& tick : ticks) {
      const double centre = scale.At(tick.value), half = LabelWidth(tick) / 2;
      fits = fits && centre - half >= end && centre + half <= width + kRightMargin;
      end = centre + half + kGap;
    }
    if (fits) return ticks;
  }
  return {};
}

std::vector<Tick> VerticalTicks(const Axis& axis, double height) {
  const auto most = static_cast<size_t>(std::max(2.0, height / 30));
  return Ticks(axis, std::min(most, kMostTicks));
}

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
  const size_t lines = 1 + AxisLines(axis, length).size();
  return static_cast<double>(lines) * kLineHeight + kGap;
}

// A panel on its way into the picture: its layout moved to its place.
struct Plot {
  const Panel& panel;
  double left, right, top, bottom;
  Scale x, y;
  SvgWriter* svg;
};

void DrawYAxis(const Plot& plot, double panel_left) {
  for (const Tick& tick : VerticalTicks(plot.panel.y, plot.bottom - plot.top)) {
    const double y = plot.y.At(tick.value);
    plot.svg->Line({plot.left, y}, {plot.right, y}, "grid");
    plot.svg->Line({plot.left - kTickLength, y}, {plot.left, y}, "frame");
    plot.svg->Text({plot.left - kGap, y + 0.35 * kTickSize}, tick.label,
                   {.size = kTickSize, .anchor = Anchor::kEnd});
  }
  double baseline = panel_left;
  for (const std::string& line : AxisLines(plot.panel.y, plot.bottom - plot.top)) {
    plot.svg->Text({baseline += kLineHeight, (plot.top + plot.bottom) / 2}, line,
                   {.size = kTextSize, .anchor = Anchor::kMiddle, .upwards = true});
  }
}

// The axis below the plot or above it; `away` is 1 or -1, the direction from the plot to its texts.
void DrawXAxis(const Plot& plot, const Axis& axis, double y, double away) {
  const Scale scale{axis.low, axis.high, plot.left, plot.right};
  plot.svg->Line({plot.left, y}, {plot.right, y}, "frame");
  const double ascent = away > 0 ? 0.8 * kTickSize : 0;
  for (const Tick& tick : HorizontalTicks(axis, plot.right - plot.left)) {
    const double x = scale.At(tick.value);
    plot.svg->Line({x, y}, {x, y + away * kTickLength}, "frame");
    plot.svg->Text({x, y + away * kGap + ascent}, tick.label,
                   {.size = kTickSize, .anchor = Anchor::kMiddle});
  }
  const std::vector<std::string> lines = AxisLines(axis, plot.right - plot.left);
  const double first = away > 0 ? 1 : -static_cast<double>(lines.size());
  double baseline = y + away * kGap + ascent + (first - 1) * kLineHeight;
  for (const std::string& line : lines) {
    plot.svg->Text({(plot.left + plot.right) / 2, baseline += kLineHeight}, line,
                   {.size = kTextSize, .anchor = Anchor::kMiddle});
  }
}

void DrawMark(const Plot& plot, const Columns& columns) {
  const double step = (columns.high - columns.low) / static_cast<double>(columns.heights.size());
  const auto x = [&](size_t edge) {
    return SvgWriter::Number(plot.x.At(columns.low + static_cast<double>(edge) * step));
  };
  const std::string bottom = SvgWriter::Number(plot.bottom);
  std::string path = "M" + x(0) + " " + bottom;
  for (size_t i = 0; i < columns.heights.size(); ++i) {
    path += "V" + SvgWriter::Number(plot.y.At(columns.heights[i])) + "H" + x(i + 1);
  }
  path += "V" + bottom;
  const std::string series = SeriesClass(columns.series);
  if (columns.filled) plot.svg->Path(path + "Z", "area " + series);
  plot.svg->Path(path, series);
}

void DrawMark(const Plot& plot, const Rule& rule) {
  const double x = plot.x.At(rule.x);
  plot.svg->Line({x, plot.top}, {x, plot.bottom}, "rule");
  const bool on_right = plot.right - x >= x - plot.left;
  plot.svg->Text({on_right ? x + kGap : x - kGap, plot.top + kLineHeight}, rule.name,
                 {.size = kTextSize, .anchor = on_right ? Anchor::kStart : Anchor::kEnd});
}

}  // namespace

PanelLayout LayoutOf(const Figure& figure, std::span<const Panel> row) {
  size_t y_lines = 0;
  double label_width = 0;
  for (const Panel& panel : figure.panels) {
    if (panel.marks.empty()) continue;
    y_lines = std::max(y_lines, AxisLines(panel.y, figure.plot_height).size());
    for (const Tick& tick : VerticalTicks(panel.y, figure.plot_height)) {
      label_width = std::max(label_width, LabelWidth(tick));
    }
  }
  PanelLayout layout;
  layout.width = figure.panel_width;
  layout.plot_left = static_cast<double>(y_lines) * kLineHeight + 2 * kGap + label_width;
  layout.plot_right = figure.panel_width - kRightMargin;

  const double plot_width = layout.plot_right - layout.plot_left;
  size_t texts = 0;
  double above = 0, plot = 0, below = 0;  // heights of axes' texts, and of the plot between them
  for (const Panel& panel : row) {
    texts = std::max(texts, TitleLines(panel, figure.panel_width).size() +
                                NoteLines(panel, figure.panel_width).size());
    if (panel.marks.empty()) continue;
    plot = figure.plot_height;
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
                  {panel.y.low, panel.y.high, bottom, top},
                  svg};
  DrawYAxis(plot, corner.x);
  for (const Mark& mark : panel.marks) {
    std::visit([&](const auto& one) { DrawMark(plot, one); }, mark);
  }
  DrawXAxis(plot, panel.x, bottom, 1);
  if (panel.upper_x) DrawXAxis(plot, *panel.upper_x, top, -1);
}

}  // namespace b4mrl
