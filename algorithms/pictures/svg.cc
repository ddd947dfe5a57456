#include "algorithms/pictures/svg.h"

#include <fmt/format.h>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

// paper: the background. frame: lines of axes. grid: lines at ticks. rule: a marked value.
// series0, ...: outlines; with `area`, what is between the outline and the axis.
constexpr std::string_view kStyle = R"(<style>
.b4mrl-picture .paper { fill: #ffffff; }
.b4mrl-picture text { fill: #222222; font-family: Helvetica, Arial, sans-serif; }
.b4mrl-picture path, .b4mrl-picture line { fill: none; stroke-width: 1; }
.b4mrl-picture .frame { stroke: #777777; }
.b4mrl-picture .grid { stroke: #e4e4e4; }
.b4mrl-picture .rule { stroke: #222222; stroke-dasharray: 4 3; }
.b4mrl-picture .series0 { stroke: #0072b2; }
.b4mrl-picture .series1 { stroke: #d55e00; }
.b4mrl-picture .area { stroke: none; fill-opacity: 0.35; }
.b4mrl-picture .area.series0 { fill: #0072b2; }
.b4mrl-picture .area.series1 { fill: #d55e00; }
@media (prefers-color-scheme: dark) {
.b4mrl-picture .paper { fill: #16181c; }
.b4mrl-picture text { fill: #e6e6e6; }
.b4mrl-picture .frame { stroke: #8a8a8a; }
.b4mrl-picture .grid { stroke: #34373d; }
.b4mrl-picture .rule { stroke: #e6e6e6; }
.b4mrl-picture .series0 { stroke: #56b4e9; }
.b4mrl-picture .series1 { stroke: #e69f00; }
.b4mrl-picture .area { stroke: none; }
.b4mrl-picture .area.series0 { fill: #56b4e9; }
.b4mrl-picture .area.series1 { fill: #e69f00; }
}
</style>
)";

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

void SvgWriter::Path(std::string_view data, std::string_view css_class) {
  body_ += fmt::format("<path class=\"{}\" d=\"{}\"/>\n", css_class, data);
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
  return fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"b4mrl-picture\" role=\"img\" "
      "width=\"{0}\" height=\"{1}\" viewBox=\"0 0 {0} {1}\">\n"
      "<title>{2}</title>\n<desc>{3}</desc>\n{4}"
      "<rect class=\"paper\" x=\"0\" y=\"0\" width=\"{0}\" height=\"{1}\"/>\n{5}</svg>\n",
      w, h, EscapeXml(title), EscapeXml(description), kStyle, body_);
}

}  // namespace b4mrl
