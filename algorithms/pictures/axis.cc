#include "algorithms/pictures/axis.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

// Absorbs the rounding of quotients: a bound that is a multiple of the step is one after division.
constexpr double kRounding = 1e-9;

// "2.50e+06" as "2.5e6".
std::string ShortExponent(const std::string& text) {
  const size_t e = text.find('e');
  std::string digits = text.substr(0, e);
  if (digits.find('.') != std::string::npos) {
    digits.erase(digits.find_last_not_of('0') + 1);
    if (digits.ends_with('.')) digits.pop_back();
  }
  return fmt::format("{}e{}", digits, std::stoi(text.substr(e + 1)));
}

// The text of a multiple of `step` on an axis whose largest tick is `largest` from zero.
std::string Label(double value, double step, double largest) {
  if (value == 0) return "0";
  const int step_exponent = static_cast<int>(std::floor(std::log10(step) + kRounding));
  if (largest < 1e6 && step_exponent >= -4) {
    return FormatFixed(value, std::max(0, -step_exponent));
  }
  const int exponent = static_cast<int>(std::floor(std::log10(std::abs(value)) + kRounding));
  return ShortExponent(fmt::format("{:.{}e}", value, std::max(0, exponent - step_exponent)));
}

}  // namespace

std::string Axis::Title() const { return unit.empty() ? name : fmt::format("{} ({})", name, unit); }

Axis Axis::OfPlaces(std::string name, std::vector<std::string> places) {
  Axis axis;
  axis.name = std::move(name);
  axis.low = -0.5;
  axis.high = static_cast<double>(places.size()) - 0.5;
  axis.places = std::move(places);
  return axis;
}

AxisRange AxisRange::Around(double low, double high) {
  const double magnitude = std::max(std::abs(low), std::abs(high));
  if (high - low > 1e-6 * magnitude) return {low, high};
  const double margin = magnitude > 0 ? 0.05 * magnitude : 1;
  return {low - margin, high + margin};
}

double RoundStep(double least) {
  const double power = std::pow(10.0, std::floor(std::log10(least) + kRounding));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= least * (1 - kRounding)) return factor * power;
  }
  return 10 * power;
}

std::vector<Tick> Ticks(const Axis& axis, size_t most) {
  std::vector<Tick> ticks;
  for (const std::string& place : axis.places) {
    ticks.push_back({static_cast<double>(ticks.size()), place});
  }
  if (!ticks.empty()) return ticks;
  double step = RoundStep((axis.high - axis.low) / static_cast<double>(most + 1));
  if (axis.whole) step = std::max(step, 1.0);
  double first = 0, last = 0;
  for (;; step = RoundStep(step * 1.5)) {
    first = std::ceil(axis.low / step - kRounding);
    last = std::floor(axis.high / step + kRounding);
    if (last - first < static_cast<double>(most)) break;
  }
  const double largest = std::max(std::abs(first), std::abs(last)) * step;
  for (double multiple = first; multiple <= last; ++multiple) {
    const double value = multiple == 0 ? 0 : multiple * step;
    ticks.push_back({value, Label(value, step, largest)});
  }
  return ticks;
}

}  // namespace b4mrl
