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
#include <span>
#include <string>
#include <vector>

#include "benchmarks/evidence/scored_run.h"
#include "data/suites/suites.h"
#include "proto/base/status.h"

namespace b4mrl {

// How a cell's score moves from the fifth before to the last one, as the mean over its seeds: by at
// most a settled curve's tolerance (curve.h), or further up or down. It has settled, too, where no
// run's policy learns any more.
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
  // Whether a run's policy still learns at its last update.
  bool Learns() const;
  Course CourseOfScore() const;
  bool IsSettled() const { return CourseOfScore() == Course::kSettled; }
  // Whether it has settled and would have with one standard error of its movement on top.
  bool IsSurelySettled() const;
  // Of the run with the fewest; one that diverged stays where it ended, however long the others
  // are, and counts only where all have.
  uint64_t LeastUpdates() const;
  uint64_t MostUpdates() const;
};

class ScoreTable {
 public:
  // All results ("*.json") of a folder (FolderOfResults). A file that is no result is named among
  // the notes. The benchmarks, which the object refers to, give the order. kIoError.
  // `main_recipes` are those of a budget, by algorithm (see MainSeries).
  static Result<ScoreTable> Read(const std::string& folder,
                                 const std::vector<Benchmark>& benchmarks,
                                 const ReadingLimit& limit,
                                 const std::map<std::string, std::string>& main_recipes,
                                 const PublishedDatasets& published);

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
  // The first of them, about files that were left out.
  std::span<const std::string> left_out() const { return std::span(notes_).first(left_out_); }

 private:
  // Where results compete for a cell, the first counts: of hyperparameters and rows those with the
  // most runs, then those with a finished one, with the most updates and with the most rows; of one
  // seed's results a finished one, then that with the most updates.
  void SortRuns();
  // Gives the runs of a cell one name of their recipe and all the benchmarks that one of them
  // names: each says what its own plan knew, by the suites and the budget of that day.
  void UniteCells();
  // A seed that is still being trained is left out of a cell that has one which has ended: the mean
  // would be neither's. One that diverged has ended.
  void LeaveOutUnfinishedSeeds();
  // Seeds that went on are read at the last evaluation that all seeds of their cell have or, where
  // these were evaluated after no equal updates, at their own last one within the shortest seed's.
  // From then on cells no longer point at whole runs alone.
  void ReadSeedsAtEqualUpdates();
  // Sets fills_a_cell, and notes the runs whose benchmarks nobody knows.
  void MarkRunsInCells(const std::vector<Benchmark>& benchmarks);
  void AddCells(const std::vector<Benchmark>& benchmarks);
  void NoteDivergedRuns();
  void NoteMixedRuns();

  std::vector<const Benchmark*> benchmarks_;
  std::vector<Series> series_;
  std::shared_ptr<std::vector<ScoredRun>> runs_;    // cells point at them, also after a move,
  std::shared_ptr<std::deque<ScoredRun>> earlier_;  // and at these, which are parts of them
  std::map<std::string, std::map<Series, Cell>> cells_;
  std::map<std::string, std::string> main_recipes_;  // by algorithm
  std::vector<std::string> notes_;
  size_t left_out_ = 0;  // of the notes
};

}  // namespace b4mrl
