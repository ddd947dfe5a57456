// Documents as Markdown, tables as CSV and LaTeX (writers.h).
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "benchmarks/pages/writers.h"
#include "data/files/csv_cell.h"

namespace b4mrl {
namespace {

// `text` with each of some characters replaced.
template <size_t kCount>
std::string Replaced(std::string_view text,
                     const std::pair<std::string_view, std::string_view> (&rules)[kCount]) {
  std::string out;
  while (!text.empty()) {
    const std::pair<std::string_view, std::string_view>* rule = nullptr;
    for (const auto& each : rules) {
      if (text.starts_with(each.first)) rule = &each;
    }
    out += rule != nullptr ? rule->second : text.substr(0, 1);
    text.remove_prefix(rule != nullptr ? rule->first.size() : 1);
  }
  return out;
}

std::string Markdown(std::string_view text) {
  static constexpr std::pair<std::string_view, std::string_view> kRules[] = {
      {"\\", "\\\\"}, {"&", "&amp;"}, {"<", "&lt;"},  {"|", "\\|"}, {"*", "\\*"}, {"_", "\\_"},
      {"`", "\\`"},   {"$", "\\$"},   {"](", "]\\("}, {"\n", " "},  {"\r", " "}};
  return Replaced(text, kRules);
}

std::string Latex(std::string_view text) {
  static constexpr std::pair<std::string_view, std::string_view> kRules[] = {
      {"\\", "\\textbackslash{}"},
      {"&", "\\&"},
      {"%", "\\%"},
      {"$", "\\$"},
      {"#", "\\#"},
      {"_", "\\_"},
      {"{", "\\{"},
      {"}", "\\}"},
      {"~", "\\textasciitilde{}"},
      {"^", "\\textasciicircum{}"},
      {"<", "\\textless{}"},
      {">", "\\textgreater{}"},
      {"|", "\\textbar{}"},
      {"[", "{[}"},  // behind \\ it would begin an option
      {"±", "$\\pm$"},
      {"×", "$\\times$"},
      {"↗", "$\\nearrow$"},
      {"↘", "$\\searrow$"},
      {"−", "$-$"},
      {"…", "\\ldots{}"},
      {"\n", " "},
      {"\r", " "}};
  return Replaced(text, kRules);
}

std::string MarkdownRow(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + Markdown(cell) + " |";
  return line + "\n";
}

struct MarkdownWriter {
  std::string text;

  void operator()(const Paragraph& block) { text += Markdown(block.text) + "\n\n"; }
  void operator()(const List& block) {
    for (const std::string& item : block.items) text += "- " + Markdown(item) + "\n";
    text += "\n";
  }
  void operator()(const Table& table) {
    text += fmt::format("**{}** {}\n\n", Markdown(table.title), Markdown(table.caption));
    std::vector<std::string> names;
    std::string rule = "|";
    for (const Column& column : table.columns) {
      names.push_back(column.name);
      rule += column.is_number ? " ---: |" : " --- |";
    }
    text += MarkdownRow(names) + rule + "\n";
    for (const auto& row : table.rows) text += MarkdownRow(row);
    text += "\n";
  }
  void operator()(const Picture& picture) {
    text += fmt::format("![{}](figures/{}.svg)\n\n", Markdown(picture.figure.title), picture.id);
  }
  void Add(const std::vector<Block>& blocks) {
    for (const Block& block : blocks) std::visit(*this, block);
  }
};

template <typename Cells, typename TextOfCell>
std::string Joined(const Cells& cells, std::string_view separator, TextOfCell text_of) {
  std::string line;
  for (const auto& cell : cells) {
    if (&cell != &cells.front()) line += separator;
    line += text_of(cell);
  }
  return line;
}

// In bytes. A column of longer sentences is wrapped: on one line, it would make its whole table
// tiny.
constexpr size_t kLongestUnwrapped = 40;
constexpr size_t kLongestWord = 25;  // that a wrapped column has room for
constexpr char kWrapped[] = "p{6cm}";
constexpr size_t kLineOfWrapped = 35;  // characters, about

// LaTeX keeps a table on one page, cut off where it is longer.
constexpr size_t kLinesOfAPage = 35;

std::string AlignmentOf(const Table& table, size_t column) {
  if (table.columns[column].is_number) return "r";
  bool has_sentences = false;
  for (const auto& row : table.rows) {
    has_sentences |= row[column].size() > kLongestUnwrapped;
    std::istringstream words(row[column]);
    for (std::string word; words >> word;) {
      if (word.size() > kLongestWord) return "l";
    }
  }
  return has_sentences ? kWrapped : "l";
}

// The rows, of each page that they take.
std::vector<std::string> LatexPages(const Table& table,
                                    const std::vector<std::string>& alignments) {
  std::vector<std::string> pages(1);
  size_t lines = 0;  // of the page
  for (const auto& row : table.rows) {
    size_t height = 1;
    for (size_t i = 0; i < row.size(); ++i) {
      if (alignments[i] == kWrapped) height = std::max(height, row[i].size() / kLineOfWrapped + 1);
    }
    if (lines > 0 && lines + height > kLinesOfAPage) {
      pages.emplace_back();
      lines = 0;
    }
    lines += height;
    pages.back() += "    " + Joined(row, " & ", Latex) + " \\\\\n";
  }
  return pages;
}

}  // namespace

std::string ToMarkdown(const Document& document) {
  MarkdownWriter writer;
  writer.text = fmt::format("# {}\n\n", Markdown(document.title));
  writer.Add(document.opening);
  for (const Section& section : document.sections) {
    writer.text += fmt::format("## {}\n\n", Markdown(section.title));
    writer.Add(section.blocks);
  }
  return writer.text;
}

std::string ToCsv(const Table& table) {
  std::string text =
      Joined(table.columns, ",", [](const Column& column) { return CsvCell(column.name); }) + "\n";
  for (const auto& row : table.rows) text += Joined(row, ",", CsvCell) + "\n";
  return text;
}

std::string ToLatex(const Table& table) {
  std::vector<std::string> alignments;
  for (size_t i = 0; i < table.columns.size(); ++i) alignments.push_back(AlignmentOf(table, i));
  const std::string names =
      Joined(table.columns, " & ", [](const Column& column) { return Latex(column.name); });
  const std::vector<std::string> pages = LatexPages(table, alignments);
  std::string text;
  for (size_t page = 0; page < pages.size(); ++page) {
    const bool is_first = page == 0;
    text += fmt::format(
        "\\begin{{table}}[t]\n  \\centering\n  \\caption{{{} {}}}\n  \\label{{tab:{}{}}}\n"
        "  \\resizebox{{\\ifdim\\width>\\textwidth\\textwidth\\else\\width\\fi}}{{!}}{{%\n"
        "  \\begin{{tabular}}{{{}}}\n    \\toprule\n    {} \\\\\n    \\midrule\n{}"
        "    \\bottomrule\n  \\end{{tabular}}}}\n\\end{{table}}\n",
        Latex(table.title),
        is_first ? Latex(table.caption)
                 : fmt::format("Continued, part {} of {}.", page + 1, pages.size()),
        table.id, is_first ? "" : fmt::format("-{}", page + 1), fmt::join(alignments, ""), names,
        pages[page]);
  }
  return text;
}

}  // namespace b4mrl
