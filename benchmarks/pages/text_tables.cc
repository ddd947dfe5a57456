// Documents as Markdown, tables as CSV and LaTeX (writers.h).
#include <fmt/format.h>

#include <sstream>
#include <string>
#include <string_view>
#include <utility>

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
  return has_sentences ? "p{6cm}" : "l";
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
  std::string alignment;
  for (size_t i = 0; i < table.columns.size(); ++i) alignment += AlignmentOf(table, i);
  std::string text = fmt::format(
      "\\begin{{table}}[t]\n  \\centering\n  \\caption{{{} {}}}\n  \\label{{tab:{}}}\n"
      "  \\resizebox{{\\ifdim\\width>\\textwidth\\textwidth\\else\\width\\fi}}{{!}}{{%\n"
      "  \\begin{{tabular}}{{{}}}\n    \\toprule\n    ",
      Latex(table.title), Latex(table.caption), table.id, alignment);
  text += Joined(table.columns, " & ", [](const Column& column) { return Latex(column.name); });
  text += " \\\\\n    \\midrule\n";
  for (const auto& row : table.rows) text += "    " + Joined(row, " & ", Latex) + " \\\\\n";
  return text + "    \\bottomrule\n  \\end{tabular}}\n\\end{table}\n";
}

}  // namespace b4mrl
