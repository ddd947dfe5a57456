#include "algorithms/pictures/legend.h"

#include <fmt/format.h>

#include "algorithms/pictures/marks.h"
#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr double kGap = 6;     // above the legend, and between a swatch and its name
constexpr double kApart = 16;  // between a name and the next swatch
constexpr double kTextSize = 12;
constexpr double kLineHeight = 17;
constexpr double kSwatchWidth = 22, kSwatchHeight = 10;

// By which kinds of marks a series is shown.
struct Look {
  bool IsShown() const { return box || bar || band || line || dot; }
  bool box = false, area = false, bar = false, band = false, line = false, dot = false;
  bool solid = false;  // not all of its lines are dashed
};

class Looks {
 public:
  explicit Looks(const Figure& figure) : looks_(figure.series.size()) {
    for (const Panel& panel : figure.panels) {
      for (const Mark& mark : panel.marks) {
        std::visit([&](const auto& one) { Add(one); }, mark);
      }
    }
  }
  const Look& operator[](size_t series) const { return looks_[series]; }

 private:
  Look& Of(size_t series) {
    if (series >= looks_.size()) looks_.resize(series + 1);
    return looks_[series];
  }
  void Add(const Columns& columns) {
    Of(columns.series).box = true;
    Of(columns.series).area |= columns.filled;
  }
  void Add(const Bars& bars) { Of(bars.series).bar = true; }
  void Add(const Dots& dots) { Of(dots.series).dot = true; }
  void Add(const Line& line) {
    if (!line.series) return;
    Of(*line.series).line = true;
    Of(*line.series).solid |= !line.dashed;
  }
  void Add(const Band& band) { Of(band.series).band = true; }
  void Add(const Rule&) {}
  void Add(const Level&) {}

  std::vector<Look> looks_;
};

void DrawSwatch(const Look& look, size_t number, Point corner, SvgWriter* svg) {
  const std::string series = SeriesClass(number);
  const std::string box =
      fmt::format("M{} {}h{}v{}h-{}Z", SvgWriter::Number(corner.x), SvgWriter::Number(corner.y),
                  kSwatchWidth, kSwatchHeight, kSwatchWidth);
  const Point middle{corner.x + kSwatchWidth / 2, corner.y + kSwatchHeight / 2};
  if (look.area) svg->Path(box, "area " + series);
  if (look.band) svg->Path(box, "band " + series);
  if (look.bar) svg->Path(box, "bar " + series);
  if (look.line) {
    svg->Path(fmt::format("M{} {}h{}", SvgWriter::Number(corner.x), SvgWriter::Number(middle.y),
                          kSwatchWidth),
              CurveClass(number, !look.solid));
  }
  if (look.dot) svg->Path(SymbolPath(number, middle), "dot " + series);
  if (look.box) svg->Path(box, series);
}

}  // namespace

double DrawLegend(const Figure& figure, Point corner, double width, SvgWriter* svg) {
  if (figure.series.size() < 2) return 0;
  const Looks looks(figure);
  double x = 0, y = kGap;
  for (size_t i = 0; i < figure.series.size(); ++i) {
    if (!looks[i].IsShown()) continue;  // in none of these panels
    const std::string& name = figure.series[i];
    const double needed = kSwatchWidth + kGap + TextWidth(name, kTextSize);
    if (x > 0 && x + needed > width) {
      x = 0;
      y += kLineHeight;
    }
    DrawSwatch(looks[i], i, {corner.x + x, corner.y + y + 2}, svg);
    svg->Text({corner.x + x + kSwatchWidth + kGap, corner.y + y + kTextSize}, name,
              {.size = kTextSize});
    x += needed + kApart;
  }
  return x > 0 ? y + kLineHeight : 0;
}

}  // namespace b4mrl
