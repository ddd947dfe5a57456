// A document: sections of paragraphs, lists, tables and figures, written as Markdown, as one HTML
// page, and its tables as CSV and LaTeX too.
//
// Texts are plain UTF-8; each writer escapes them for its format. Value types; any thread.
#pragma once

#include <string>
#include <variant>
#include <vector>

#include "algorithms/pictures/figure.h"

namespace b4mrl {

struct Paragraph {
  std::string text;
};

struct List {
  std::vector<std::string> items;
};

struct Column {
  std::string name;
  bool is_number = false;  // aligned on the right
};

struct Table {
  std::string id;  // name of its files: "claims"
  std::string title;
  std::string caption;  // a sentence or several; how its entries are to be read
  std::vector<Column> columns;
  std::vector<std::vector<std::string>> rows;  // as long as the columns
};

struct Picture {
  std::string id;  // name of its file
  Figure figure;
};

using Block = std::variant<Paragraph, List, Table, Picture>;

struct Section {
  std::string title;
  std::vector<Block> blocks;
};

struct Document {
  std::string title;
  std::vector<Block> opening;
  std::vector<Section> sections;

  // All blocks of a kind, in their order.
  template <typename Kind>
  std::vector<const Kind*> All() const;
};

template <typename Kind>
std::vector<const Kind*> Document::All() const {
  std::vector<const Kind*> found;
  const auto add = [&found](const std::vector<Block>& blocks) {
    for (const Block& block : blocks) {
      if (const auto* kind = std::get_if<Kind>(&block)) found.push_back(kind);
    }
  };
  add(opening);
  for (const Section& section : sections) add(section.blocks);
  return found;
}

}  // namespace b4mrl
