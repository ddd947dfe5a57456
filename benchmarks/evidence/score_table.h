// The scores of results as a table: which algorithm came how far on which benchmark.
//
// A result of a run fills the cells of all benchmarks that it names. Results of one cell, which
// differ in seed or precision alone, are its runs; runs of other hyperparameters have another
// recipe and are another series: "mopo (short)" beside "mopo (paper)". A series is what tables have
// a column for. Value types; any thread; no clock: equal results make equal tables.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "benchmarks/records/curve.h"
#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

struct Series {
  std::string algorithm;  // "hymopo", or the name of a user's own learner
  std::string recipe;     // "" for algorithms with a single one
  auto operator<=>(const Series&) const = default;
};

// A run as its result tells of it, at its last evaluation that counts (see ReadingLimit).
struct ScoredRun {
  std::string id, cell_id, file;  // `file` without its folder
  Series series;
  std::string simulator, dataset;  // "": none
  std::string dataset_file;        // with its version: "HalfCheetah/medium-v0"
  uint64_t rows = 0;               // of that
  std::vector<std::string> benchmarks;
  uint64_t seed = 0;
  double score = 0;        // normalised; the return where the task has no reference returns
  bool is_return = false;  // `score` is a return
  uint64_t updates = 0;
  bool ended = false;                     // its training is over, or goes on beyond what counts
  Fifths fifths;                          // of the curve
  Curve curve;                            // until then
  bool fills_a_cell = false;              // of a benchmark that the table knows
  std::map<std::string, double> further;  // "full", "served": the agent's scores seen otherwise
  double core_hours = 0;                  // of the whole run
  std::optional<uint64_t> simulator_steps, query_rows, dataset_rows;
  std::string budget, precision, source, version, commit, processor, kernel, columns_sha256;

  // The run as it was at its last evaluation within so many updates; nothing if it had none.
  std::optional<ScoredRun> At(uint64_t end) const;
};

// How a cell's score moves from the fifth before to the last one, as the mean over its seeds: by at
// most a settled curve's tolerance (curve.h), or further up or down.
enum class Course {
  kSettled,
  kRising,  // or a run has not ended
  kFalling,
  kUntold,  // every run has ended, and one was evaluated too rarely
};

struct Cell {
  std::vector<const ScoredRun*> runs;  // one a seed, ascending

  std::vector<double> Scores() const;
  double Mean() const;
  double Deviation() const;  // over the seeds, divided by their number
  // The mean over the seeds of something that a run may lack; nothing if one lacks it.
  std::optional<double> MeanOf(
      const std::function<std::optional<double>(const ScoredRun&)>& value) const;
  Course CourseOfScore() const;
  bool IsSettled() const { return CourseOfScore() == Course::kSettled; }
  uint64_t LeastUpdates() const;
  uint64_t MostUpdates() const;
};

// Until which update a run counts; nothing: all of it.
using ReadingLimit = std::function<std::optional<uint64_t>(const ScoredRun& run)>;

class ScoreTable {
 public:
  // All results ("*.json") of a folder (FolderOfResults). A file that is no result is named among
  // the notes. The benchmarks, which the object refers to, give the order. kIoError.
  // `main_recipes` are those of a budget, by algorithm (see MainSeries).
  static Result<ScoreTable> Read(const std::string& folder,
                                 const std::vector<Benchmark>& benchmarks,
                                 const ReadingLimit& limit,
                                 const std::map<std::string, std::string>& main_recipes);

  // Those with a cell, in the order of the suites.
  const std::vector<const Benchmark*>& benchmarks() const { return benchmarks_; }
  // Algorithms in the field's order (online, offline, hybrid), then users' own by name.
  const std::vector<Series>& series() const { return series_; }
  const std::vector<ScoredRun>& runs() const { return *runs_; }
  // Null if there is none.
  const Cell* Find(const std::string& benchmark, const Series& series) const;
  // The series that stands for an algorithm where only one can: that of its main recipe or, if it
  // never ran with that one, that with the most cells.
  std::optional<Series> MainSeries(const std::string& algorithm) const;
  // What a reader of the tables must know: files that were left out, means over several processors.
  const std::vector<std::string>& notes() const { return notes_; }

 private:
  // Where results compete for a cell, the first counts: of hyperparameters and rows those with the
  // most runs, of one seed's results a finished one, then that with the most updates.
  void SortRuns();
  // A seed that is still being trained is left out of a cell that has one which has ended: the mean
  // would be neither's.
  void LeaveOutUnfinishedSeeds();
  // Seeds that went on are read at the updates that all seeds of their cell have. From then on
  // cells no longer point at whole runs alone.
  void ReadSeedsAtEqualUpdates();
  // Sets fills_a_cell, and notes the runs whose benchmarks nobody knows.
  void MarkRunsInCells();
  void AddCells(const std::vector<Benchmark>& benchmarks);
  void NoteMixedRuns();

  std::vector<const Benchmark*> benchmarks_;
  std::vector<Series> series_;
  std::shared_ptr<std::vector<ScoredRun>> runs_;  // cells point at them, also after a move,
  std::shared_ptr<std::deque<ScoredRun>> earlier_;  // and at these, which are parts of them
  std::map<std::string, std::map<Series, Cell>> cells_;
  std::map<std::string, std::string> main_recipes_;  // by algorithm
  std::vector<std::string> notes_;
};

// "TD3", "HyMOPO"; a user's own name as it is.
std::string DisplayName(const std::string& algorithm);
// "HyMOPO (short)".
std::string DisplayName(const Series& series);
// The place of an algorithm in the field's order; users' own come last.
size_t OrderOf(const std::string& algorithm);

}  // namespace b4mrl
