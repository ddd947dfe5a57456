#include "algorithms/pictures/tick_labels.h"

#include <algorithm>
#include <cmath>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr size_t kMostTicks = 7;     // of numbers
constexpr double kGap = 6;           // between neighbouring labels
constexpr double kRowGap = 3;        // between the names of places below each other
constexpr double kFirstLine = 14;    // the height of a label with one line
constexpr size_t kMostLines = 3;     // of a name below its place
constexpr double kMostTurned = 240;  // the length of a turned name's line

double WidthOf(const std::vector<std::string>& lines) {
  double width = 0;
  for (const std::string& line : lines) width = std::max(width, TextWidth(line, kTickSize));
  return width;
}

// Numbers as labels of one line.
TickLabels LabelsOf(const std::vector<Tick>& ticks) {
  TickLabels labels;
  for (const Tick& tick : ticks) labels.labels.push_back({tick.value, {tick.label}});
  return labels;
}

// As many ticks as have room for their labels beside each other; none if not even one has.
std::vector<Tick> NumbersBelow(const Axis& axis, double width) {
  for (size_t most = kMostTicks; most > 0; --most) {
    const std::vector<Tick> ticks = Ticks(axis, most);
    bool fits = true;
    double end = -kRightMargin;
    for (const Tick& tick : ticks) {
      const double centre = (tick.value - axis.low) / (axis.high - axis.low) * width;
      const double half = TextWidth(tick.label, kTickSize) / 2;
      fits = fits && centre - half >= end && centre + half <= width + kRightMargin;
      end = centre + half + kGap;
    }
    if (fits) return ticks;
  }
  return {};
}

// Whether no word of the name is wider than a line.
bool HasRoomForWords(std::string_view name, double width) {
  while (!name.empty()) {
    const size_t end = std::min(name.find(' '), name.size());
    if (TextWidth(name.substr(0, end), kTickSize) > width) return false;
    name.remove_prefix(std::min(end + 1, name.size()));
  }
  return true;
}

// The names of places in lines of at most `width` pixels.
TickLabels NamesOf(const Axis& axis, double width) {
  TickLabels names;
  for (const Tick& tick : Ticks(axis, axis.places.size())) {
    names.labels.push_back({tick.value, WrapText(tick.label, kTickSize, width)});
  }
  return names;
}

size_t MostLines(const TickLabels& labels) {
  size_t lines = 1;
  for (const TickLabel& label : labels.labels) lines = std::max(lines, label.lines.size());
  return lines;
}

// The names turned, for places that are `distance` pixels apart. If the longest name has more lines
// than stand between two places, the lines become as long as they need to be.
TickLabels TurnedNames(const Axis& axis, double distance) {
  const auto room = static_cast<size_t>(std::max(1.0, distance / kTickLineHeight));
  double width = kMostTurned;
  while (MostLines(NamesOf(axis, width)) > room) width *= 1.25;
  TickLabels names = NamesOf(axis, width);
  names.upwards = true;
  for (const TickLabel& label : names.labels) {
    names.extent = std::max(names.extent, WidthOf(label.lines) + kRowGap);
  }
  // Where even single lines are too near each other, one name stands for several places.
  const auto each = static_cast<size_t>(std::ceil(kTickLineHeight / distance));
  for (size_t i = names.labels.size(); i-- > 0;) {
    if (i % each != 0) names.labels.erase(names.labels.begin() + static_cast<ptrdiff_t>(i));
  }
  return names;
}

}  // namespace

TickLabels LabelsBelow(const Axis& axis, double width) {
  if (axis.places.empty()) {
    TickLabels numbers = LabelsOf(NumbersBelow(axis, width));
    numbers.extent = kFirstLine;
    return numbers;
  }
  const double distance = width / static_cast<double>(axis.places.size());
  TickLabels names = NamesOf(axis, distance - kGap);
  const size_t lines = MostLines(names);
  const bool fits =
      std::all_of(axis.places.begin(), axis.places.end(),
                  [&](const std::string& name) { return HasRoomForWords(name, distance - kGap); });
  if (!fits || lines > kMostLines) return TurnedNames(axis, distance);
  names.extent = kFirstLine + static_cast<double>(lines - 1) * kTickLineHeight;
  return names;
}

TickLabels LabelsBeside(const Axis& axis, double height, double most) {
  const size_t ticks = std::min(static_cast<size_t>(std::max(2.0, height / 30)), kMostTicks);
  TickLabels labels = axis.places.empty() ? LabelsOf(Ticks(axis, ticks)) : NamesOf(axis, most);
  for (const TickLabel& label : labels.labels) {
    labels.extent = std::max(labels.extent, WidthOf(label.lines));
  }
  return labels;
}

double LeastHeight(const Axis& axis, double most) {
  if (axis.places.empty()) return 0;
  const auto lines = static_cast<double>(MostLines(NamesOf(axis, most)));
  return static_cast<double>(axis.places.size()) * (lines * kTickLineHeight + kRowGap);
}

}  // namespace b4mrl
