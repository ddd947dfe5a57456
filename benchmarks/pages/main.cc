// `b4mrl report`: tables, figures and claims from the results of a suite.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstddef>
#include <string>

#include "algorithms/base/within_memory.h"
#include "benchmarks/pages/report.h"
#include "benchmarks/pages/writers.h"
#include "proto/base/exit_codes.h"
#include "proto/base/version.h"
#include "proto/command_line/program.h"
#include "proto/command_line/words.h"

namespace b4mrl {
namespace {

constexpr size_t kMostLines = 20;  // about results that were left out

// Says which results were left out; none may be left.
Status TellLeftOut(const ScoreTable& table) {
  const auto left_out = table.left_out();
  for (const std::string& note : left_out.first(std::min(left_out.size(), kMostLines))) {
    fmt::print(stderr, "{:.1000}\n", note);  // which may hold a name of any length
  }
  if (left_out.size() > kMostLines) {
    fmt::print(stderr, "and {} more; the report's last section has all of them\n",
               left_out.size() - kMostLines);
  }
  if (!table.benchmarks().empty()) return Status();
  return Status(StatusCode::kInvalidArgument, "every result was left out");
}

Status Report(const ReportOptions& options, const std::string& out) {
  B4MRL_ASSIGN_OR_RETURN(const Evidence evidence, GatherEvidence(options));
  B4MRL_RETURN_IF_ERROR(TellLeftOut(evidence.table));
  if (out.empty()) {
    fmt::print("{}", ToMarkdown(MakeReport(evidence)));
    return Status();
  }
  B4MRL_RETURN_IF_ERROR(WriteReport(evidence, out));
  fmt::print("{}/report.html\n", out);
  return Status();
}

int Main(int argc, char** argv) {
  CLI::App app("Turns results into tables, figures, tested claims and one page to read.",
               "b4mrl report");
  app.set_version_flag("--version", VersionText());
  app.option_defaults()->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
  ReportOptions options;
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
  if (const auto code = ParseWords(app, {argv + 1, argv + argc})) return *code;
  Status status;
  const Status memory = WithinMemory("this command", [&] {
    status = Report(options, out);
    return Status();
  });
  if (memory.ok() && status.ok()) return kExitDone;
  fmt::print(stderr, "b4mrl report: {}\n", memory.ok() ? status.message() : memory.message());
  return memory.ok() ? kExitBadInput : kExitFailed;
}

}  // namespace
}  // namespace b4mrl

int main(int argc, char** argv) {
  return b4mrl::RunProgram("b4mrl report", [=] { return b4mrl::Main(argc, argv); });
}
