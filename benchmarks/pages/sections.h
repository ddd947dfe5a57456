// The sections of a report, each from the evidence alone. Pure functions; any thread.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "benchmarks/evidence/claims.h"
#include "benchmarks/evidence/other_rows.h"
#include "benchmarks/evidence/score_table.h"
#include "benchmarks/evidence/scores.h"
#include "benchmarks/pages/document.h"
#include "data/suites/suites.h"

namespace b4mrl {

// Why a score is far from the paper's.
struct Explanation {
  std::string score;  // as tables show it without its mark, "30.8 ± 5.2": it explains no other
  std::string why;
};

// What a report tells of. The table refers to the benchmarks, so evidence is moved, not copied.
struct Evidence {
  Evidence() = default;
  Evidence(Evidence&&) = default;
  Evidence& operator=(Evidence&&) = default;

  std::vector<Benchmark> benchmarks;  // of all suites
  ScoreTable table;
  CellScores paper;
  BorrowedDeviations deviations;
  CellScores ours;  // each algorithm by its main series
  std::optional<OtherRows> other_rows;
  std::vector<Claim> claims;
  std::map<CellName, Explanation> explanations;
  // The paper's table of errors: environment, error, our perturbation, its parameter, its value.
  std::vector<std::vector<std::string>> parameters;
};

std::vector<Block> Opening(const Evidence& evidence);  // how much ran, beside the paper
Section GainSection(const Evidence& evidence);        // whether hybrids are worth their two sources
Section TablesSection(const Evidence& evidence);      // the paper's tables, and ours beside them
Section FiguresSection(const Evidence& evidence);     // the paper's figures
Section ClaimsSection(const Evidence& evidence);      // its claims, and ours, tested
Section AgreementSection(const Evidence& evidence);   // rank correlations with the paper
Section AggregatesSection(const Evidence& evidence);  // over many benchmarks
Section CurvesSection(const Evidence& evidence);      // learning curves
Section CellsSection(const Evidence& evidence);       // every cell with its interval and its cost
Section ErrorsSection(const Evidence& evidence);      // what is wrong in which environment
Section OriginSection(const Evidence& evidence);      // what ran where, and what to beware of

// Every cell of ours as numbers, for programs.
Table CellsAsNumbers(const Evidence& evidence);
// Ours in the columns of the paper's tables:
// table,challenge,dataset,discrepancy,algorithm,mean,std.
Table CellsAsThePaper(const Evidence& evidence);

}  // namespace b4mrl
