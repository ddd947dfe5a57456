// Documents as one HTML page (writers.h).
#include <fmt/format.h>

#include "algorithms/pictures/text.h"
#include "benchmarks/pages/writers.h"

namespace b4mrl {
namespace {

constexpr char kStyle[] = R"css(
:root { color-scheme: light dark; --text: #1b1b1b; --faint: #5c5c5c; --paper: #fff;
  --rule: #d4d4d4; --band: #f5f6f7;
  --link: #0b57a4; }
@media (prefers-color-scheme: dark) {
  :root { --text: #e8e8e8; --faint: #a6a6a6; --paper: #16181b; --rule: #3c4045; --band: #1f2226;
    --link: #8ab8ec; }
}
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 84rem; padding: 1rem 1.25rem 4rem; background: var(--paper);
  color: var(--text); font: 16px/1.5 system-ui, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0; }
h2 { font-size: 1.3rem; margin: 2.5rem 0 .75rem; padding-top: .5rem;
  border-top: 1px solid var(--rule); }
p, li { max-width: 46rem; overflow-wrap: anywhere; }
a { color: var(--link); }
nav ol { columns: 16rem; padding-left: 1.25rem; margin: 1rem 0; }
figure { margin: 1.5rem 0; }
figure > div { overflow-x: auto; }
figure svg { display: block; }
figcaption { max-width: 46rem; margin-bottom: .5rem; color: var(--faint); }
figcaption b { color: var(--text); }
table { border-collapse: collapse; font-size: .85rem; line-height: 1.35;
  font-variant-numeric: tabular-nums; border-top: 2px solid var(--text);
  border-bottom: 2px solid var(--text); }
th, td { padding: .25rem .6rem; text-align: left; vertical-align: top; white-space: nowrap; }
th { border-bottom: 1px solid var(--text); font-weight: 600; vertical-align: bottom;
  white-space: normal; }
.number { text-align: right; }
.words { min-width: 14rem; white-space: normal; }
tbody th { border-bottom: 0; font-weight: inherit; vertical-align: top; white-space: nowrap; }
tbody tr:nth-child(even) { background: var(--band); }
@media print {
  :root { --text: #000; --faint: #444; --paper: #fff; --rule: #bbb; --band: #f2f2f2; --link: #000; }
  @page { size: A4 landscape; margin: 12mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  figure > div { overflow: visible; }
  figure svg { max-width: 100%; max-height: 175mm; width: auto; height: auto; }
  figure.picture { break-inside: avoid; }
  table { font-size: 6.5pt; width: 100%; }
  th, td { padding: .1rem .25rem; }
  td, tbody th, .words { min-width: 0; white-space: normal; }
  tr, h2 { break-inside: avoid; break-after: auto; }
  h2 { break-after: avoid; }
  nav { display: none; }
}
)css";

// Entries of more characters are sentences, which need a width of their own.
constexpr size_t kWords = 40;

std::string AnchorOf(size_t section) { return fmt::format("section-{}", section + 1); }

struct HtmlWriter {
  std::string text;

  void operator()(const Paragraph& block) { text += "<p>" + EscapeXml(block.text) + "</p>\n"; }
  void operator()(const List& block) {
    text += "<ul>\n";
    for (const std::string& item : block.items) text += "<li>" + EscapeXml(item) + "</li>\n";
    text += "</ul>\n";
  }
  void operator()(const Table& table) {
    // Who has no mouse scrolls a box that takes the focus.
    text += fmt::format(
        "<figure id=\"{0}\"><figcaption><b id=\"{0}-title\">{1}</b> {2}</figcaption>"
        "<div tabindex=\"0\" role=\"region\" aria-labelledby=\"{0}-title\">"
        "<table aria-labelledby=\"{0}-title\">\n",
        EscapeXml(table.id), EscapeXml(table.title), EscapeXml(table.caption));
    text += "<thead><tr>";
    for (const Column& column : table.columns) {
      text += fmt::format("<th scope=\"col\"{}>{}</th>",
                          column.is_number ? " class=\"number\"" : "", EscapeXml(column.name));
    }
    text += "</tr></thead>\n<tbody>\n";
    for (const auto& row : table.rows) {
      text += "<tr>";
      for (size_t i = 0; i < row.size(); ++i) {
        const char* css_class = table.columns[i].is_number ? " class=\"number\""
                                : row[i].size() > kWords   ? " class=\"words\""
                                                           : "";
        text += i == 0 ? fmt::format("<th scope=\"row\"{}>{}</th>", css_class, EscapeXml(row[i]))
                       : fmt::format("<td{}>{}</td>", css_class, EscapeXml(row[i]));
      }
      text += "</tr>\n";
    }
    text += "</tbody></table></div></figure>\n";
  }
  void operator()(const Picture& picture) {
    text += fmt::format(
        "<figure id=\"{}\" class=\"picture\"><div tabindex=\"0\" role=\"region\" "
        "aria-label=\"{}\">\n{}</div></figure>\n",
        EscapeXml(picture.id), EscapeXml(picture.figure.title), RenderSvg(picture.figure));
  }
  void Add(const std::vector<Block>& blocks) {
    for (const Block& block : blocks) std::visit(*this, block);
  }
};

}  // namespace

std::string ToHtml(const Document& document) {
  HtmlWriter writer;
  const std::string title = EscapeXml(document.title);
  writer.text = fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>{}</title>\n<style>{}</style>\n</head>\n<body>\n<main>\n<h1>{}</h1>\n",
      title, kStyle, title);
  writer.Add(document.opening);
  writer.text += "<nav aria-label=\"Sections\"><ol>\n";
  for (size_t i = 0; i < document.sections.size(); ++i) {
    writer.text += fmt::format("<li><a href=\"#{}\">{}</a></li>\n", AnchorOf(i),
                               EscapeXml(document.sections[i].title));
  }
  writer.text += "</ol></nav>\n";
  for (size_t i = 0; i < document.sections.size(); ++i) {
    writer.text +=
        fmt::format("<h2 id=\"{}\">{}</h2>\n", AnchorOf(i), EscapeXml(document.sections[i].title));
    writer.Add(document.sections[i].blocks);
  }
  return writer.text + "</main>\n</body>\n</html>\n";
}

}  // namespace b4mrl
