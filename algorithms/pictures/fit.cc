#include "algorithms/pictures/fit.h"

#include <algorithm>
#include <limits>

namespace b4mrl {
namespace {

constexpr double kMargin = 0.04;  // of the marks' range, at each end

// The least and the largest of the numbers added so far.
class Extent {
 public:
  void Add(double value) {
    low_ = std::min(low_, value);
    high_ = std::max(high_, value);
  }
  void Add(const std::vector<double>& values) {
    for (const double value : values) Add(value);
  }
  void Add(const std::optional<AxisRange>& range) {
    if (!range) return;
    Add(range->low);
    Add(range->high);
  }
  // Adds the 0 at which bars and columns begin.
  void AddBase() {
    Add(0);
    has_base_ = true;
  }
  bool empty() const { return low_ > high_; }
  AxisRange WithMargin() const {
    const AxisRange range = AxisRange::Around(low_, high_);
    const double margin = kMargin * (range.high - range.low);
    // Bars that all point the same way begin at the axis' end, without a margin.
    return {has_base_ && low_ == 0 ? 0 : range.low - margin,
            has_base_ && high_ == 0 ? 0 : range.high + margin};
  }

 private:
  double low_ = std::numeric_limits<double>::infinity();
  double high_ = -std::numeric_limits<double>::infinity();
  bool has_base_ = false;
};

struct Extents {
  Extent x, y;
};

void Add(const Columns& columns, const Panel&, Extents* all) {
  all->x.Add(AxisRange{columns.low, columns.high});
  all->y.Add(columns.heights);
  all->y.AddBase();
}

void Add(const Bars& bars, const Panel& panel, Extents* all) {
  Extent& along = panel.y.places.empty() ? all->y : all->x;
  along.AddBase();
  for (const Bar& bar : bars.bars) {
    along.Add(bar.value);
    along.Add(bar.interval);
  }
}

void Add(const Dots& dots, const Panel&, Extents* all) {
  for (const Dot& dot : dots.dots) {
    all->x.Add(dot.x);
    all->x.Add(dot.x_interval);
    all->y.Add(dot.y);
    all->y.Add(dot.y_interval);
  }
}

void Add(const Line& line, const Panel&, Extents* all) {
  all->x.Add(line.x);
  all->y.Add(line.y);
}

void Add(const Band& band, const Panel&, Extents* all) {
  all->x.Add(band.x);
  all->y.Add(band.low);
  all->y.Add(band.high);
}

void Add(const Rule& rule, const Panel&, Extents* all) { all->x.Add(rule.x); }

void Add(const Level& level, const Panel&, Extents* all) { all->y.Add(level.y); }

void Fit(std::span<Panel> panels, Axis Panel::*axis, Extent Extents::*along) {
  Extents extents;
  for (const Panel& panel : panels) {
    for (const Mark& mark : panel.marks) {
      std::visit([&](const auto& one) { Add(one, panel, &extents); }, mark);
    }
  }
  if ((extents.*along).empty()) return;
  const AxisRange range = (extents.*along).WithMargin();
  for (Panel& panel : panels) {
    if (!(panel.*axis).places.empty()) continue;
    (panel.*axis).low = range.low;
    (panel.*axis).high = range.high;
  }
}

}  // namespace

void FitX(std::span<Panel> panels) { Fit(panels, &Panel::x, &Extents::x); }

void FitY(std::span<Panel> panels) { Fit(panels, &Panel::y, &Extents::y); }

}  // namespace b4mrl
