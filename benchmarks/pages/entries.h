// How numbers of cells are written in tables. Pure functions; any thread; no locale.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "benchmarks/evidence/score_table.h"
#include "benchmarks/evidence/scores.h"

namespace b4mrl {

inline constexpr char kMissing[] = "-";       // of a cell that nothing fills
inline constexpr char kNotDefined[] = "n/a";  // of a cell that nothing can fill
// Of a score that decides nothing: it still rises, it falls, or of neither can be told.
inline constexpr char kRisingMark[] = "↗", kFallingMark[] = "↘", kUntoldMark[] = "?";
inline constexpr char kUnsettledMark[] = "~";  // of a number that rests on such scores

// "46.4", "46.4 ± 0.3" from several seeds.
std::string PlainScoreEntry(const CellScore& score);
// The same with a mark if it has not settled: "46.4 ↗" of a cell that still rises.
std::string ScoreEntry(const CellScore& score);
// "46.4 ± 0.3 (3×100k)": seeds and updates as well.
std::string CellEntry(const Cell& cell);
// "100k"; "100k to 300k" where seeds differ.
std::string UpdatesEntry(const Cell& cell);
// "3" or "1 to 3".
std::string RangeOf(const std::string& least, const std::string& most);
// "100k", "1M", "1,250".
std::string Amount(uint64_t count);
std::string Amount(const std::optional<double>& count);  // rounded; kMissing for nothing
// "+3.1", "-20.4".
std::string Signed(double points);
// The points that a doubling of the updates adds, "+4.3"; kMissing where that is not known.
std::string GainEntry(const CellScore& score);
// With so many digits behind the point; kMissing for nothing.
std::string Fixed(const std::optional<double>& value, int digits);
// "[44.1, 48.7]" with so many digits behind the point; kMissing for nothing.
std::string IntervalEntry(const std::optional<Interval>& interval, int digits);
// "[44.1, 48.7]", "[44.1, 48.7]*" where the deviation between seeds is borrowed.
std::string IntervalEntry(const CellScore& score);

// The label of the paper's table about a challenge, "trans_error"; "" if it has none.
std::string PaperTableOf(const std::string& challenge);
// Where the paper has the benchmark's challenge, in sentences: "The paper's table trans_error."
std::string OriginOf(const Benchmark& benchmark);
// The dataset's level, "medium-expert"; kMissing without one.
std::string LevelOf(const Benchmark& benchmark);
// What is wrong: "data: hidden-high; simulator: gravity"; "nothing".
std::string FlawsOf(const Benchmark& benchmark);

}  // namespace b4mrl
