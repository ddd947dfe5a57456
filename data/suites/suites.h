// Benchmarks: a simulator, a dataset, their flaws, and the world in which policies are scored.
// Suites are TOML files that list benchmarks as products; this reads them, for the daemon, for both
// clients and for the runner alike.
//
//   version = "v0"
//   environment = "HalfCheetah"
//   [[challenge]]
//   name = "confounding"
//   simulators = ["gravity"]
//   corruptions = ["hidden-low", "hidden-high"]
//   datasets = ["medium", "medium-expert"]
//
// are four benchmarks. A challenge takes each simulator with each corruption and each dataset. A
// list that is left out stands for the true simulator, the dataset as recorded, or no dataset; so
// does "" in a list. Other keys of a challenge:
//   label            in the names of its benchmarks, before the rest
//   algorithms       the only ones that it is defined for; left out: all, without a dataset those
//                    that need none
//   except           those that it is not defined for
//   world            perturbations under which its data were recorded and policies are scored
//   hyperparameters  a table of those that differ from their defaults, as numbers; true is 1
//
// A benchmark is named ENVIRONMENT/CHALLENGE/VARIED+DATASET. VARIED is the corruption if there is
// one, else the simulator; of a challenge with a label, the label and the corruption. Two
// benchmarks of one name are refused. Pure functions; any thread.
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "proto/base/status.h"

namespace b4mrl {

inline constexpr size_t kMaxBenchmarks = 2048;    // of all suites together
inline constexpr size_t kMaxBenchmarkText = 128;  // characters of each name in a suite's file

// A score that the paper prints: mean and standard deviation of three seeds.
struct PaperScore {
  double mean = 0;
  double std = 0;
};

struct Benchmark {
  std::string name;
  std::string suite;                    // its suite's version: "v0"
  std::string environment;              // "HalfCheetah"
  std::string challenge;                // "confounding"
  std::string simulator;                // perturbations: "gravity"; "": the true simulator
  std::string dataset;                  // "HalfCheetah/medium"; "": none
  std::string corruption;               // perturbations: "hidden-high"; "": the data as recorded
  std::string world;                    // perturbations of the true environment; "": none
  std::vector<std::string> algorithms;  // the only ones that it is defined for; empty: all
  std::vector<std::string> exceptions;  // those that it is not defined for
  std::map<std::string, double> hyperparameters;
  std::map<std::string, PaperScore> paper;  // by algorithm

  // Whether the benchmark is defined for an algorithm that uses what the benchmark has.
  bool DefinedFor(std::string_view algorithm) const;
};

// The benchmarks of one suite's text, in the file's order, without the paper's scores. `file` is
// the name in messages. Errors: kInvalidArgument names file, line or challenge, and what is
// allowed; kLimitExceeded for more benchmarks than kMaxBenchmarks.
Result<std::vector<Benchmark>> ParseSuite(const std::string& text, const std::string& file);

// The benchmarks of all files "*.toml" of these folders, in the order of folders and of file names,
// with the scores of their files "*.csv" (columns: benchmark,algorithm,mean,std). A folder that is
// "" is passed over. Errors: those of ParseSuite, and kIoError.
Result<std::vector<Benchmark>> ReadSuites(const std::vector<std::string>& folders);

// The folder of the project's own suites: where they were installed, or the checkout's; "" if there
// is none.
std::string DefaultSuitesFolder();

}  // namespace b4mrl
