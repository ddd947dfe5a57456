// A picture as a reader of XML sees it: its elements, and where its texts stand. For tests.
#pragma once

#include <tinyxml2.h>

#include <catch2/catch.hpp>
#include <string>
#include <vector>

#include "algorithms/pictures/text.h"

namespace b4mrl {

struct TextBox {
  std::string text;
  double left = 0, right = 0, top = 0, bottom = 0;  // by the estimated width

  bool Overlaps(const TextBox& other) const {
    return left < other.right && other.left < right && top < other.bottom && other.top < bottom;
  }
};

class SvgDocument {
 public:
  // Fails the test case if `svg` is not well-formed.
  explicit SvgDocument(const std::string& svg) {
    REQUIRE(document_.Parse(svg.data(), svg.size()) == tinyxml2::XML_SUCCESS);
    REQUIRE(std::string(root().Name()) == "svg");
  }

  const tinyxml2::XMLElement& root() const { return *document_.RootElement(); }
  double width() const { return root().DoubleAttribute("width"); }
  double height() const { return root().DoubleAttribute("height"); }
  std::string title() const { return root().FirstChildElement("title")->GetText(); }

  std::vector<TextBox> Texts() const {
    std::vector<TextBox> boxes;
    for (const auto* text = root().FirstChildElement("text"); text != nullptr;
         text = text->NextSiblingElement("text")) {
      boxes.push_back(BoxOf(*text));
    }
    return boxes;
  }
  bool Says(const std::string& words) const {
    for (const TextBox& box : Texts()) {
      if (box.text == words) return true;
    }
    return false;
  }
  // How many elements `name` have this class.
  size_t Count(const char* name, const std::string& css_class) const {
    size_t count = 0;
    for (const auto* one = root().FirstChildElement(name); one != nullptr;
         one = one->NextSiblingElement(name)) {
      count += one->Attribute("class", css_class.c_str()) != nullptr ? 1 : 0;
    }
    return count;
  }
  void CheckThatTextsAreApart() const {
    const std::vector<TextBox> texts = Texts();
    for (size_t i = 0; i < texts.size(); ++i) {
      INFO(texts[i].text);
      CHECK(texts[i].left >= 0);
      CHECK(texts[i].right <= width());
      CHECK(texts[i].top >= 0);
      CHECK(texts[i].bottom <= height());
      for (size_t k = 0; k < i; ++k) {
        INFO("and " << texts[k].text);
        if (texts[i].Overlaps(texts[k])) FAIL_CHECK("these texts overlap");
      }
    }
  }

 private:
  static TextBox BoxOf(const tinyxml2::XMLElement& text) {
    const double x = text.DoubleAttribute("x"), y = text.DoubleAttribute("y");
    const double size = text.DoubleAttribute("font-size");
    const bool bold = text.Attribute("font-weight") != nullptr;
    TextBox box;
    box.text = text.GetText();
    const double width = TextWidth(box.text, bold ? size * kBoldWidening : size);
    const std::string anchor = text.Attribute("text-anchor");
    const double before = anchor == "start" ? 0 : anchor == "middle" ? width / 2 : width;
    // Of the font size, digits and capitals rise by 0.73 above the baseline and letters sink by
    // 0.24 below it, in DejaVu Sans.
    const double rise = 0.73 * size, sink = 0.24 * size;
    if (text.Attribute("transform") != nullptr) {  // to be read from below
      box.left = x - rise;
      box.right = x + sink;
      box.top = y - (width - before);
      box.bottom = y + before;
    } else {
      box.left = x - before;
      box.right = x - before + width;
      box.top = y - rise;
      box.bottom = y + sink;
    }
    return box;
  }

  tinyxml2::XMLDocument document_;
};

}  // namespace b4mrl
