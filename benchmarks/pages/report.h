// The report on a folder of results: `b4mrl report`.
//
// It reads results, suites and claims, and has no clock: equal results give equal bytes. Thread
// rule: one thread.
#pragma once

#include <string>

#include "benchmarks/pages/document.h"
#include "benchmarks/pages/sections.h"
#include "proto/base/status.h"

namespace b4mrl {

struct ReportOptions {
  std::string folder;  // of results, or of a suite's runs with "results" inside
  std::string suites;  // a folder of further suites; "": none
  // Until where runs count: a number of updates, or a budget's name or file; "": all of them. A
  // budget's recipes stand for their algorithms where only one can; otherwise the default's do.
  std::string at;
};

// Errors: kIoError, kInvalidArgument and kUnknownName of the files and the options.
Result<Evidence> GatherEvidence(const ReportOptions& options);

Document MakeReport(const Evidence& evidence);

// Writes report.md, report.html, tables/*.csv, tables/*.tex and figures/*.svg into a folder, which
// is made. kIoError.
Status WriteReport(const Evidence& evidence, const std::string& folder);

}  // namespace b4mrl
