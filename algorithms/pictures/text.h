// Text in pictures: escaping for XML, numbers for readers, estimated widths and line breaks.
//
// Nobody knows the font with which a picture will be shown, so widths are upper estimates for the
// usual sans-serif fonts. Text is UTF-8. Pure functions; any thread; no locale.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace b4mrl {

// `text` as it stands in XML between tags or in an attribute. Control characters, which XML
// forbids, and bytes that are not UTF-8 become U+FFFD, the replacement character.
std::string EscapeXml(std::string_view text);

// The width of one line in pixels, at a font size in pixels. Bold text is as wide as text of a font
// size that is larger by the factor kBoldWidening.
inline constexpr double kBoldWidening = 1.1;
double TextWidth(std::string_view text, double font_size);

// Breaks `text` at spaces into lines of at most `width` pixels; a longer word is broken inside. ""
// has no lines.
std::vector<std::string> WrapText(std::string_view text, double font_size, double width);

// A finite number with `decimals` digits behind the point and commas between thousands: "-4,767.2".
std::string FormatFixed(double value, int decimals);
// A finite number with at most six significant digits: "4,767.23", "-0.25", "1.5e-07".
std::string FormatNumber(double value);

}  // namespace b4mrl
