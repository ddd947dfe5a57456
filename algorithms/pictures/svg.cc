#include "algorithms/pictures/svg.h"

#include <fmt/format.h>

#include <array>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

// Colours of the series. The first eight light ones are Okabe and Ito's without their yellow, which
// fades on white, and a wine red; the dark ones are the like on a dark page. Under simulated
// protanopia and deuteranopia all pairs stay at least 14 apart in CIELAB.
constexpr std::array<std::string_view, kSeriesColours> kLight = {
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00",
    "#56b4e9", "#222222", "#882255", "#5b3fe0", "#3d4f0e"};
constexpr std::array<std::string_view, kSeriesColours> kDark = {
    "#56b4e9", "#e69f00", "#29c29a", "#e08fbf", "#f9f075",
    "#3f8f8f", "#f2f2f2", "#b04a4a", "#8a6cff", "#86863c"};

// paper: the background. frame: lines of axes. grid: lines at ticks. rule: a marked value.
// series0, ...: outlines in a series' colour; with `area`, `band` or `bar`, what they enclose;
// `dot` and `open` are symbols, filled and hollow.
constexpr std::string_view kShapes =
    R"(.b4mrl-picture text { font-family: Helvetica, Arial, sans-serif; }
.b4mrl-picture path, .b4mrl-picture line { fill: none; stroke: currentColor; stroke-width: 1; }
.b4mrl-picture .rule { stroke-dasharray: 4 3; }
.b4mrl-picture .curve { stroke-width: 1.8; stroke-linejoin: round; }
.b4mrl-picture .dashed { stroke-dasharray: 6 4; }
.b4mrl-picture .dotted { stroke-dasharray: 2 2; }
.b4mrl-picture .dashed.dotted { stroke-dasharray: 8 3 2 3; }
.b4mrl-picture .whisker { stroke-width: 1.4; }
.b4mrl-picture .area { stroke: none; fill: currentColor; fill-opacity: 0.35; }
.b4mrl-picture .band { stroke: none; fill: currentColor; fill-opacity: 0.2; }
.b4mrl-picture .bar { fill: currentColor; fill-opacity: 0.35; }
.b4mrl-picture .dot { fill: currentColor; }
)";

struct Theme {
  std::string_view paper, text, frame, grid;
  std::array<std::string_view, kSeriesColours> series;
};
constexpr Theme kLightTheme = {"#ffffff", "#222222", "#777777", "#e4e4e4", kLight};
constexpr Theme kDarkTheme = {"#16181c", "#e6e6e6", "#8a8a8a", "#34373d", kDark};

std::string ColoursOf(const Theme& theme) {
  std::string css = fmt::format(
      ".b4mrl-picture .paper, .b4mrl-picture .open {{ fill: {}; }}\n"
      ".b4mrl-picture text {{ fill: {}; }}\n"
      ".b4mrl-picture .rule {{ color: {}; }}\n"
      ".b4mrl-picture .frame {{ color: {}; }}\n"
      ".b4mrl-picture .grid {{ color: {}; }}\n",
      theme.paper, theme.text, theme.text, theme.frame, theme.grid);
  for (size_t i = 0; i < theme.series.size(); ++i) {
    css += fmt::format(".b4mrl-picture .{} {{ color: {}; }}\n", SeriesClass(i), theme.series[i]);
  }
  return css;
}

// Paper is white, so pages are printed in the light theme.
std::string StyleSheet() {
  return fmt::format(
      "<style>\n{}{}@media screen and (prefers-color-scheme: dark) {{\n{}}}\n</style>\n", kShapes,
      ColoursOf(kLightTheme), ColoursOf(kDarkTheme));
}

std::string_view AnchorWord(TextStyle::Anchor anchor) {
  switch (anchor) {
    case TextStyle::Anchor::kStart:
      return "start";
    case TextStyle::Anchor::kMiddle:
      return "middle";
    case TextStyle::Anchor::kEnd:
      return "end";
  }
  return "start";
}

}  // namespace

std::string CurveClass(size_t series, bool dashed) {
  const char* dotted = series < kSeriesColours ? "" : "dotted ";
  return fmt::format("{}{}curve {}", dashed ? "dashed " : "", dotted, SeriesClass(series));
}
std::string SeriesClass(size_t series) { return fmt::format("series{}", series % kSeriesColours); }

std::string SvgWriter::Number(double value) {
  std::string text = fmt::format("{:.2f}", value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.ends_with('.')) text.pop_back();
  return text == "-0" ? "0" : text;
}

void SvgWriter::Rectangle(Point corner, double width, double height, std::string_view css_class) {
  body_ +=
      fmt::format("<rect class=\"{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>\n", css_class,
                  Number(corner.x), Number(corner.y), Number(width), Number(height));
}

void SvgWriter::Line(Point from, Point to, std::string_view css_class) {
  body_ += fmt::format("<line class=\"{}\" x1=\"{}\" y1=\"{}\" x2=\"{}\" y2=\"{}\"/>\n", css_class,
                       Number(from.x), Number(from.y), Number(to.x), Number(to.y));
}

void SvgWriter::Path(std::string_view data, std::string_view css_class, std::string_view hint) {
  body_ += fmt::format("<path class=\"{}\" d=\"{}\"", css_class, data);
  body_ += hint.empty() ? "/>\n" : fmt::format("><title>{}</title></path>\n", EscapeXml(hint));
}

void SvgWriter::Text(Point at, std::string_view text, const TextStyle& style) {
  const std::string x = Number(at.x), y = Number(at.y);
  body_ += fmt::format(
      "<text x=\"{}\" y=\"{}\" font-size=\"{}\" text-anchor=\"{}\"{}{}>{}</text>\n", x, y,
      Number(style.size), AnchorWord(style.anchor), style.bold ? " font-weight=\"bold\"" : "",
      style.upwards ? fmt::format(" transform=\"rotate(-90 {} {})\"", x, y) : "", EscapeXml(text));
}

std::string SvgWriter::Finish(double width, double height, std::string_view title,
                              std::string_view description) const {
  const std::string w = Number(width), h = Number(height);
  const std::string described =
      description.empty() ? "" : fmt::format("<desc>{}</desc>\n", EscapeXml(description));
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"b4mrl-picture\" role=\"img\" "
      "width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\">\n"
      "<title>{2}</title>\n{3}{4}"
      "<rect class=\"paper\" x=\"0\" y=\"0\" width=\"{0}\" height=\"{1}\"/>\n{5}</svg>\n",
      w, h, EscapeXml(title), described, StyleSheet(), body_);
}

}  // namespace b4mrl
