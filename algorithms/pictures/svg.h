// Writes one SVG document: rectangles, lines, paths and text, in colours that follow the reader's
// light or dark theme.
//
// Shapes name a class of the style sheet instead of a colour; the classes are listed in svg.cc. The
// sheet applies inside the class "b4mrl-picture" alone, so that several pictures can stand in one
// HTML page. Coordinates are in pixels from the top left corner. Equal calls give equal bytes.
// Thread rule: one thread.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace b4mrl {

// Series are told apart by colours, which readers with any kind of colour vision can tell apart.
// Further series take the first colours again, with dotted curves.
inline constexpr size_t kSeriesColours = 10;
std::string SeriesClass(size_t series);  // "series0"
std::string CurveClass(size_t series, bool dashed);

struct TextStyle {
  double size = 12;
  enum class Anchor { kStart, kMiddle, kEnd } anchor = Anchor::kStart;
  bool bold = false;
  bool upwards = false;  // turned by 90 degrees, to be read from below
};

struct Point {  // in pixels
  double x = 0;
  double y = 0;
};

class SvgWriter {
 public:
  void Rectangle(Point corner, double width, double height, std::string_view css_class);
  void Line(Point from, Point to, std::string_view css_class);
  // `data` is SVG's path syntax, made from the letters of its commands and from Number. Browsers
  // show `hint` while the pointer rests on the path.
  void Path(std::string_view data, std::string_view css_class, std::string_view hint = {});
  // `at` is the baseline's point at the anchor.
  void Text(Point at, std::string_view text, const TextStyle& style);

  // The document. `title` and `description`, which may be "", are for screen readers.
  std::string Finish(double width, double height, std::string_view title,
                     std::string_view description) const;

  // A coordinate with at most two digits behind the point: "12.5".
  static std::string Number(double value);

 private:
  std::string body_;
};

}  // namespace b4mrl
