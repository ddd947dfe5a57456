#include "benchmarks/pages/writers.h"

#include <fmt/format.h>

#include <catch2/catch.hpp>

namespace b4mrl {
namespace {

using Catch::Contains;

Table HostileTable() {
  return {"t",
          "A_b & c.",
          "50% of <b> \"x\", $1 {y} #2.",
          {{"Name"}, {"Value", true}},
          {{"a|b*c", "1 ± 2 ↗"}, {"\"q\", r", "<0.001"}}};
}

Document DocumentOf(const Table& table) {
  Document document;
  document.title = "T <1>";
  document.opening.emplace_back(Paragraph{"p & q"});
  document.sections.push_back({"One", {List{{"first", "second"}}, table}});
  return document;
}

TEST_CASE("CSV quotes what has commas or quotes") {
  CHECK(ToCsv(HostileTable()) == "Name,Value\na|b*c,1 ± 2 ↗\n\"\"\"q\"\", r\",<0.001\n");
}

TEST_CASE("LaTeX escapes its special characters and draws booktabs' rules") {
  const std::string text = ToLatex(HostileTable());
  CHECK_THAT(text, Contains("\\caption{A\\_b \\& c. 50\\% of \\textless{}b\\textgreater{}"));
  CHECK_THAT(text, Contains("\\$1 \\{y\\} \\#2."));
  CHECK_THAT(text, Contains("\\begin{tabular}{lr}"));
  CHECK_THAT(text, Contains("1 $\\pm$ 2 $\\nearrow$ \\\\"));
  CHECK_THAT(text, Contains("\\toprule") && Contains("\\midrule") && Contains("\\bottomrule"));
}

TEST_CASE("LaTeX gets a long table in parts that fit a page, with every row once and in order") {
  Table table = {"t", "Title.", "Caption.", {{"Name"}}, {}};
  for (int i = 0; i < 80; ++i) table.rows.push_back({fmt::format("row{}", i)});
  const std::string text = ToLatex(table);
  size_t at = 0;
  for (const auto& row : table.rows) {
    at = text.find(row.front() + " \\\\", at);
    REQUIRE(at != std::string::npos);
  }
  CHECK_THAT(text, Contains("\\caption{Title. Caption.}") && Contains("\\label{tab:t}"));
  CHECK_THAT(text, Contains("\\caption{Title. Continued, part 3 of 3.}") && Contains("{tab:t-3}"));
  CHECK(text.find("part 4") == std::string::npos);
}

TEST_CASE("Markdown tables keep their columns whatever the entries hold") {
  const std::string text = ToMarkdown(DocumentOf(HostileTable()));
  CHECK_THAT(text, Contains("# T &lt;1>\n\np &amp; q\n"));
  CHECK_THAT(text, Contains("- first\n- second\n"));
  CHECK_THAT(text, Contains("| Name | Value |\n| --- | ---: |\n| a\\|b\\*c | 1 ± 2 ↗ |\n"));
}

TEST_CASE("Backslashes, formulas, links and line ends of a name stay text") {
  const Table table = {"t", "T.", "", {{"Name"}}, {{"a\\|b"}, {"[x](y)"}, {"$x$"}, {"1\r\r## 2"}}};
  const std::string text = ToMarkdown(DocumentOf(table));
  CHECK_THAT(text, Contains("| a\\\\\\|b |") && Contains("| [x]\\(y) |"));
  CHECK_THAT(text, Contains("| \\$x\\$ |") && Contains("| 1  ## 2 |"));
  CHECK_THAT(ToLatex(table), Contains("\n    {[}x](y) \\\\"));
}

TEST_CASE("The page escapes texts, names its sections and needs no other file") {
  const std::string page = ToHtml(DocumentOf(HostileTable()));
  CHECK_THAT(page, Contains("<title>T &lt;1&gt;</title>"));
  CHECK_THAT(page, Contains("50% of &lt;b&gt; &quot;x&quot;"));
  CHECK_THAT(page, Contains("<th scope=\"row\">a|b*c</th><td class=\"number\">1 ± 2 ↗</td>"));
  CHECK_THAT(page, Contains("<a href=\"#section-1\">One</a>") && Contains("<h2 id=\"section-1\">"));
  for (const char* foreign : {"<script", "src=", "<link", "url(", "@import"}) {
    CAPTURE(foreign);
    CHECK(page.find(foreign) == std::string::npos);
  }
}

}  // namespace
}  // namespace b4mrl
