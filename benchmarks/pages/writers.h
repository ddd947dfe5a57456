// Writes documents and their tables. Pure functions; any thread; equal documents, equal bytes.
#pragma once

#include <string>

#include "benchmarks/pages/document.h"

namespace b4mrl {

// CommonMark with tables; figures are linked as figures/<id>.svg.
std::string ToMarkdown(const Document& document);

// One file without scripts and without other files, light or dark as the reader's system, for
// screens of 390 pixels and wider, and for paper. Tables and figures that are wider than the screen
// scroll inside.
std::string ToHtml(const Document& document);

// The columns' names and the rows (RFC 4180).
std::string ToCsv(const Table& table);

// A `table` with booktabs' rules, or several of one page each, to be \input; needs the packages
// booktabs and graphicx, whose \resizebox narrows wider tables to the text's width. pdflatex knows
// Latin letters; names in other scripts need lualatex or xelatex and a font that has them.
std::string ToLatex(const Table& table);

}  // namespace b4mrl
