#include "benchmarks/pages/entries.h"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <vector>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

// Where the paper has a challenge: the label of its table, if any, and what is to be said of it, in
// these environments (""; in all).
struct PaperPlace {
  std::string_view challenge, label, note, environments;
};
constexpr PaperPlace kPaperPlaces[] = {
    {"modelling-error", "trans_error", "", ""},
    {"partial-observability-simulator", "obs_error", "", ""},
    {"partial-observability-dataset", "partial_obs_new_ds", "", ""},
    {"action-discrepancy", "action_error", "", ""},
    {"confounding", "conf_error_full",
     "Its table conf_error, of the main text, has the rows with hidden dimensions.", ""},
    {"dimensions", "", "The paper's figure conf, of which it prints no numbers.", ""},
    {"simulators", "sim2real_res",
     "Of Hopper and Walker2d it prints two rows each without saying which is of which error: these "
     "4 of its 395 scores are compared with nothing.",
     "Hopper Walker2d"},
};

const PaperPlace* PlaceOf(const std::string& challenge) {
  const auto* place = std::ranges::find(kPaperPlaces, challenge, &PaperPlace::challenge);
  return place == std::end(kPaperPlaces) ? nullptr : place;
}

// With a space before it; "" of a score that has settled.
std::string MarkOf(Course course) {
  switch (course) {
    case Course::kRising:
      return fmt::format(" {}", kRisingMark);
    case Course::kFalling:
      return fmt::format(" {}", kFallingMark);
    case Course::kUntold:
      return fmt::format(" {}", kUntoldMark);
    case Course::kSettled:
      break;
  }
  return "";
}

}  // namespace

std::string PlainScoreEntry(const CellScore& score) {
  std::string text = Fixed(score.mean, 1);
  if (score.seeds > 1) text += fmt::format(" ± {:.1f}", score.std);
  return text;
}

std::string ScoreEntry(const CellScore& score) {
  return PlainScoreEntry(score) + MarkOf(score.course);
}

std::string UpdatesEntry(const Cell& cell) {
  return RangeOf(Amount(cell.LeastUpdates()), Amount(cell.MostUpdates()));
}

std::string RangeOf(const std::string& least, const std::string& most) {
  return least == most ? least : fmt::format("{} to {}", least, most);
}

std::string CellEntry(const Cell& cell) {
  std::string text = Fixed(cell.Mean(), 1);
  if (cell.runs.size() > 1) text += fmt::format(" ± {:.1f}", cell.Deviation());
  text += MarkOf(cell.CourseOfScore());
  return fmt::format("{} ({}×{})", text, cell.runs.size(), UpdatesEntry(cell));
}

std::string Amount(uint64_t count) {
  if (count >= 1'000'000 && count % 1'000'000 == 0) return fmt::format("{}M", count / 1'000'000);
  if (count >= 1'000 && count % 1'000 == 0) return fmt::format("{}k", count / 1'000);
  return FormatFixed(static_cast<double>(count), 0);
}

std::string Amount(const std::optional<double>& count) {
  return count ? FormatFixed(*count, 0) : kMissing;
}

std::string Signed(double points) {
  const std::string text = fmt::format("{:+.1f}", points);
  return text == "-0.0" ? "+0.0" : text;
}

std::string Fixed(const std::optional<double>& value, int digits) {
  if (!value) return kMissing;
  const std::string text = fmt::format("{:.{}f}", *value, digits);
  // No "-0.00".
  const bool is_zero = text.find_first_not_of("-0.") == std::string::npos;
  return is_zero && text.starts_with('-') ? text.substr(1) : text;
}

std::string IntervalEntry(const std::optional<Interval>& interval, int digits) {
  if (!interval) return kMissing;
  return fmt::format("[{}, {}]", Fixed(interval->low, digits), Fixed(interval->high, digits));
}

std::string IntervalEntry(const CellScore& score) {
  return IntervalEntry(score.Interval95(), 1) + (score.is_borrowed ? "*" : "");
}

std::string PaperTableOf(const std::string& challenge) {
  const PaperPlace* place = PlaceOf(challenge);
  return place == nullptr ? "" : std::string(place->label);
}

std::string GainEntry(const CellScore& score) {
  return score.gain_per_doubling ? Signed(*score.gain_per_doubling) : kMissing;
}

std::string OriginOf(const Benchmark& benchmark) {
  const PaperPlace* place = PlaceOf(benchmark.challenge);
  if (place == nullptr) return "Not in the paper.";
  if (place->label.empty()) return std::string(place->note);
  const std::string table = fmt::format("The paper's table {}.", place->label);
  const bool has_note = !place->note.empty() &&
                        (place->environments.empty() ||
                         place->environments.find(benchmark.environment) != std::string_view::npos);
  return has_note ? fmt::format("{} {}", table, place->note) : table;
}

std::string LevelOf(const Benchmark& benchmark) {
  if (benchmark.dataset.empty()) return kMissing;
  return benchmark.dataset.substr(benchmark.dataset.find('/') + 1);
}

std::string FlawsOf(const Benchmark& benchmark) {
  std::vector<std::string> flaws;
  if (!benchmark.corruption.empty()) flaws.push_back("data: " + benchmark.corruption);
  if (!benchmark.simulator.empty()) flaws.push_back("simulator: " + benchmark.simulator);
  if (!benchmark.world.empty()) flaws.push_back("world: " + benchmark.world);
  for (const auto& [name, value] : benchmark.hyperparameters) {
    flaws.push_back(fmt::format("{} {}", name, value));
  }
  return flaws.empty() ? "nothing" : fmt::format("{}", fmt::join(flaws, "; "));
}

}  // namespace b4mrl
