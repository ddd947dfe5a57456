#include "algorithms/pictures/marks.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>

namespace b4mrl {
namespace {

constexpr double kRadius = 4;         // of symbols
constexpr double kCap = 3;            // half of the line across a whisker's end
constexpr double kRuleTextSize = 11;  // of a rule's name
constexpr double kRuleTextDrop = 14;  // from the plot's upper end to its baseline
constexpr double kGap = 6;            // between a rule and its name

using Anchor = TextStyle::Anchor;

std::string Pair(double x, double y) { return SvgWriter::Number(x) + " " + SvgWriter::Number(y); }

// An open line through points; "Z" behind it closes it.
std::string PathThrough(const std::vector<Point>& points) {
  std::string path;
  for (const Point& point : points) path += (path.empty() ? "M" : "L") + Pair(point.x, point.y);
  return path;
}

void Draw(const Plot& plot, const Columns& columns) {
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

// A line along an axis from value `range.low` to `range.high`, with a stroke across each end.
void DrawWhisker(const Plot& plot, bool along_x, const AxisRange& range, double across,
                 size_t series) {
  const Scale& scale = along_x ? plot.x : plot.y;
  std::string path;
  for (const double value : {range.low, range.high}) {
    const double end = scale.At(value);
    path += along_x
                ? fmt::format("M{}V{}", Pair(end, across - kCap), SvgWriter::Number(across + kCap))
                : fmt::format("M{}H{}", Pair(across - kCap, end), SvgWriter::Number(across + kCap));
  }
  const double low = scale.At(range.low), high = scale.At(range.high);
  path += along_x ? fmt::format("M{}H{}", Pair(low, across), SvgWriter::Number(high))
                  : fmt::format("M{}V{}", Pair(across, low), SvgWriter::Number(high));
  plot.svg->Path(path, "whisker " + SeriesClass(series));
}

void Draw(const Plot& plot, const Bars& bars) {
  const bool along_x = !plot.panel.y.places.empty();
  const Scale& along = along_x ? plot.x : plot.y;
  const Scale& across = along_x ? plot.y : plot.x;
  for (const Bar& bar : bars.bars) {
    const double from = along.At(0), to = along.At(bar.value);
    const double one = across.At(bar.at - bars.width / 2),
                 other = across.At(bar.at + bars.width / 2);
    const std::vector<Point> corners =
        along_x ? std::vector<Point>{{from, one}, {to, one}, {to, other}, {from, other}}
                : std::vector<Point>{{one, from}, {one, to}, {other, to}, {other, from}};
    plot.svg->Path(PathThrough(corners) + "Z", (bar.open ? "" : "bar ") + SeriesClass(bars.series),
                   bar.hint);
    if (bar.interval) DrawWhisker(plot, along_x, *bar.interval, across.At(bar.at), bars.series);
  }
}

void Draw(const Plot& plot, const Dots& dots) {
  for (const Dot& dot : dots.dots) {
    const Point centre{plot.x.At(dot.x), plot.y.At(dot.y)};
    if (dot.x_interval) DrawWhisker(plot, true, *dot.x_interval, centre.y, dots.series);
    if (dot.y_interval) DrawWhisker(plot, false, *dot.y_interval, centre.x, dots.series);
    plot.svg->Path(SymbolPath(dots.series, centre),
                   (dot.open ? "open " : "dot ") + SeriesClass(dots.series), dot.hint);
  }
}

void Draw(const Plot& plot, const Line& line) {
  std::vector<Point> points;
  for (size_t i = 0; i < line.x.size(); ++i) {
    points.push_back({plot.x.At(line.x[i]), plot.y.At(line.y[i])});
  }
  const std::string frame = line.dashed ? "dashed frame" : "frame";
  plot.svg->Path(PathThrough(points), line.series ? CurveClass(*line.series, line.dashed) : frame);
}

void Draw(const Plot& plot, const Band& band) {
  std::vector<Point> edge;
  for (size_t i = 0; i < band.x.size(); ++i) {
    edge.push_back({plot.x.At(band.x[i]), plot.y.At(band.high[i])});
  }
  for (size_t i = band.x.size(); i-- > 0;) {
    edge.push_back({plot.x.At(band.x[i]), plot.y.At(band.low[i])});
  }
  plot.svg->Path(PathThrough(edge) + "Z", "band " + SeriesClass(band.series));
}

void Draw(const Plot& plot, const Rule& rule) {
  const double x = plot.x.At(rule.x);
  plot.svg->Line({x, plot.top}, {x, plot.bottom}, "rule");
  if (rule.name.empty()) return;
  const bool on_right = plot.right - x >= x - plot.left;
  plot.svg->Text({on_right ? x + kGap : x - kGap, plot.top + kRuleTextDrop}, rule.name,
                 {.size = kRuleTextSize, .anchor = on_right ? Anchor::kStart : Anchor::kEnd});
}

void Draw(const Plot& plot, const Level& level) {
  const double y = plot.y.At(level.y);
  plot.svg->Line({plot.left, y}, {plot.right, y}, "rule");
}

// A polygon or, with an inner radius, a star. Sizes are for areas that look alike.
struct Symbol {
  int corners;
  double turn;    // of the first corner from the top, in degrees
  double radius;  // of the corners, in multiples of kRadius
  double inner;   // of the corners between them; 0 for none
};
constexpr std::array<Symbol, 9> kSymbols = {{
    {24, 0, 1, 0},      // a disc
    {4, 45, 1.25, 0},   // a square
    {3, 0, 1.4, 0},     // a triangle
    {4, 0, 1.3, 0},     // a diamond
    {3, 180, 1.4, 0},   // a triangle upside down
    {4, 0, 1.6, 0.5},   // a plus
    {5, 0, 1.6, 0.65},  // a star
    {4, 45, 1.6, 0.5},  // a cross
    {6, 0, 1.15, 0},    // a hexagon
}};

}  // namespace

std::string SymbolPath(size_t series, Point centre) {
  const Symbol& symbol = kSymbols[series % kSymbols.size()];
  const int points = symbol.inner > 0 ? 2 * symbol.corners : symbol.corners;
  std::vector<Point> outline;
  for (int i = 0; i < points; ++i) {
    const bool inside = symbol.inner > 0 && i % 2 == 1;
    const double radius = kRadius * (inside ? symbol.inner : symbol.radius);
    const double angle = (symbol.turn / 180 + 2.0 * i / points) * std::numbers::pi;
    outline.push_back({centre.x + radius * std::sin(angle), centre.y - radius * std::cos(angle)});
  }
  return PathThrough(outline) + "Z";
}

void DrawMark(const Plot& plot, const Mark& mark) {
  std::visit([&](const auto& one) { Draw(plot, one); }, mark);
}

}  // namespace b4mrl
