// `b4mrl report`: tables, figures and claims from the results of a suite.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "benchmarks/pages/report.h"
#include "benchmarks/pages/writers.h"
#include "proto/base/exit_codes.h"
#include "proto/base/version.h"

int main(int argc, char** argv) {
  CLI::App app("Turns results into tables, figures, tested claims and one page to read.",
               "b4mrl report");
  app.set_version_flag("--version", b4mrl::VersionText());
  b4mrl::ReportOptions options;
  std::string out;
  app.add_option("folder", options.folder, "results, or the --out folder of b4mrl benchmark run")
      ->required();
  app.add_option(
      "--out", out,
      "folder for report.html, report.md, tables (CSV, LaTeX) and figures (SVG); without "
      "it the report is printed as Markdown");
  app.add_option("--at", options.at,
                 "count each run until so many updates, or until those of a budget (name or file)");
  app.add_option("--suites", options.suites, "folder of further suites");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? b4mrl::kExitDone : b4mrl::kExitBadUsage;
  }
  const auto evidence = b4mrl::GatherEvidence(options);
  b4mrl::Status status = evidence.status();
  if (status.ok() && out.empty()) {
    const std::string text = b4mrl::ToMarkdown(b4mrl::MakeReport(*evidence));
    std::fwrite(text.data(), 1, text.size(), stdout);
  } else if (status.ok()) {
    status = b4mrl::WriteReport(*evidence, out);
    if (status.ok()) fmt::print("{}/report.html\n", out);
  }
  if (status.ok()) return b4mrl::kExitDone;
  fmt::print(stderr, "b4mrl report: {}\n", status.message());
  return b4mrl::kExitBadInput;
}
