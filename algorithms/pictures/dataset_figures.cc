#include "algorithms/pictures/dataset_figures.h"

#include <fmt/format.h>

#include <algorithm>

#include "algorithms/pictures/text.h"

namespace b4mrl {
namespace {

constexpr double kHeadroom = 1.08;      // of an axis above its highest column
constexpr double kRuleHeadroom = 1.25;  // the same with a rule's name above the columns

std::string Whole(uint64_t count) { return FormatFixed(static_cast<double>(count), 0); }

std::string Counted(uint64_t count, const std::string& thing) {
  return fmt::format("{} {}{}", Whole(count), thing, count == 1 ? "" : "s");
}

// "3 NaN, 1 infinite"; "" if all numbers are finite.
std::string NotFinite(const NumberRange& range) {
  std::string words;
  if (range.nans() > 0) words = Whole(range.nans()) + " NaN";
  if (range.infinities() > 0) {
    words += (words.empty() ? "" : ", ") + Whole(range.infinities()) + " infinite";
  }
  return words;
}

// The columns of a histogram, in shares of `whole`.
Columns ColumnsOf(const Histogram& bins, double whole, size_t series, double* highest) {
  Columns columns{series, series == 0, bins.low(), bins.high(), {}};
  for (const uint64_t count : bins.counts()) {
    columns.heights.push_back(static_cast<double>(count) / whole);
    *highest = std::max(*highest, columns.heights.back());
  }
  return columns;
}

std::string TitleOf(const DatasetDescription& dataset, const std::string& what) {
  return fmt::format("{}: {}", dataset.name, what);
}

// One dataset's values in one dimension, as a series of a panel.
struct Values {
  const NumberRange& range;
  const Histogram& bins;
  std::string series;  // its name, where there are several
  bool hidden = false;
};

// What is said of a series in words, without its name; "" if the picture shows all.
std::string NoteOn(const Values& values) {
  std::vector<std::string> words;
  const NumberRange& range = values.range;
  if (range.count() == 0) words.push_back("no rows");
  if (range.low() == range.high()) {
    words.push_back((range.finite() == range.count() ? "always " : "all finite values are ") +
                    FormatNumber(range.low()));
  }
  if (const std::string others = NotFinite(range); !others.empty()) words.push_back(others);
  const std::string note = fmt::format("{}", fmt::join(words, "; "));
  if (!values.hidden) return note;
  return note.empty() ? "hidden" : "hidden: " + note;
}

// The notes of a panel: one for all series if it is the same, else one for each that has any.
std::vector<std::string> NotesOn(const std::vector<Values>& all) {
  std::vector<std::string> notes, named;
  for (const Values& values : all) {
    notes.push_back(NoteOn(values));
    if (!notes.back().empty()) named.push_back(values.series + ": " + notes.back());
  }
  const bool same = std::ranges::count(notes, notes[0]) == std::ssize(notes);
  if (!same) return named;
  return notes[0].empty() ? std::vector<std::string>() : std::vector{notes[0]};
}

// The dimensions of a dataset's observations or actions.
struct Dimensions {
  std::string kind;        // "observation"
  const SpaceSpec* space;  // null where nobody knows their names
};

// `space` describes dimensions only if it has as many as the dataset.
Dimensions DimensionsOf(std::string kind, const SpaceSpec* space, size_t size) {
  return {std::move(kind), space != nullptr && space->size() == size ? space : nullptr};
}

Panel DimensionPanel(const Dimensions& dimensions, size_t index, const std::vector<Values>& all) {
  Panel panel;
  panel.title = fmt::format("{} {}", dimensions.kind, index);
  panel.notes = NotesOn(all);
  panel.x = {"value", "unit unknown", all[0].bins.low(), all[0].bins.high()};
  if (dimensions.space != nullptr) {
    const DimensionSpec& dimension = dimensions.space->dimensions[index];
    panel.title += ": " + dimension.name;
    panel.x.name = dimension.name;
    panel.x.unit = dimension.unit.empty() ? "no unit" : dimension.unit;
  }
  panel.y = {.name = "rows", .unit = "%"};
  double highest = 0;
  for (size_t i = 0; i < all.size(); ++i) {
    if (!all[i].range.varies()) continue;
    const double percent = static_cast<double>(all[i].range.count()) / 100;
    panel.marks.push_back(ColumnsOf(all[i].bins, percent, i, &highest));
  }
  panel.y.high = highest * kHeadroom;
  return panel;
}

// Distributes `panels` over as many figures like `pattern` as they need.
std::vector<Figure> Pages(const Figure& pattern, const std::vector<Panel>& panels) {
  std::vector<Figure> figures;
  for (size_t first = 0; first < panels.size(); first += kMostPanels) {
    const size_t end = std::min(first + kMostPanels, panels.size());
    Figure& figure = figures.emplace_back(pattern);
    if (panels.size() > kMostPanels) {
      figure.title += fmt::format(" {} to {} of {}", first, end - 1, panels.size());
    }
    figure.panels.assign(panels.begin() + static_cast<ptrdiff_t>(first),
                         panels.begin() + static_cast<ptrdiff_t>(end));
  }
  return figures;
}

Figure GridFigure(const DatasetDescription& dataset, const std::string& what, uint64_t rows,
                  size_t panels) {
  Figure figure;
  figure.title = TitleOf(dataset, what);
  figure.sentences = {Counted(rows, "row") + "; each column is the share of rows in one bin."};
  figure.columns = std::clamp<size_t>(panels, 2, 4);
  figure.panel_width = 240;
  figure.plot_height = 100;
  return figure;
}

}  // namespace

Figure ReturnsFigure(const DatasetDescription& dataset, const DatasetTally& tally) {
  const NumberRange& returns = tally.returns();
  Figure figure;
  figure.title = TitleOf(dataset, "returns of " + Counted(returns.count(), "complete episode"));
  if (tally.has_open_episode()) {
    figure.sentences.push_back("The last episode is not complete and left out.");
  }
  if (const std::string others = NotFinite(returns); !others.empty()) {
    figure.sentences.push_back(fmt::format("Returns that are not drawn: {}.", others));
  }
  if (returns.finite() == 0) return figure;
  if (returns.varies()) {
    figure.sentences.push_back(fmt::format("The returns lie between {} and {}.",
                                           FormatNumber(returns.low()),
                                           FormatNumber(returns.high())));
  }
  const Histogram& bins = tally.return_bins();
  const double width = (bins.high() - bins.low()) / static_cast<double>(bins.counts().size());
  Panel panel;
  panel.x = {"episode return", "sum of rewards", bins.low(), bins.high()};
  panel.y = {.name = "episodes", .unit = "per bin of " + FormatNumber(width), .whole = true};
  double highest = 0;
  panel.marks.push_back(ColumnsOf(bins, 1, 0, &highest));
  panel.y.high = highest * kRuleHeadroom;
  std::string mean = "mean " + FormatNumber(returns.mean());
  const auto score = [&](double value) { return dataset.environment->NormalisedScore(value); };
  if (dataset.environment && score(returns.mean())) {
    const EnvironmentSpec& spec = *dataset.environment;
    panel.upper_x =
        Axis{"normalised score",
             fmt::format("0: return {}, 100: return {}", FormatNumber(*spec.reference_min),
                         FormatNumber(*spec.reference_max)),
             *score(bins.low()), *score(bins.high())};
    mean += ", normalised score " + FormatFixed(*score(returns.mean()), 1);
  }
  panel.marks.push_back(Rule{returns.mean(), mean});
  figure.panels.push_back(std::move(panel));
  return figure;
}

std::vector<Figure> ObservationFigures(const DatasetDescription& dataset, const DatasetTally& tally,
                                       const DatasetTally* clean) {
  const size_t size = tally.observations().size();
  Figure figure = GridFigure(dataset, "observations", tally.rows(), size);
  if (clean != nullptr) {
    figure.series = {"clean", "corrupted"};
    figure.sentences.push_back(fmt::format("Corrupted by {}.", dataset.corruption));
  }
  const Dimensions dimensions = DimensionsOf(
      "observation", dataset.environment ? &dataset.environment->observation : nullptr, size);
  std::vector<Panel> panels;
  for (size_t i = 0; i < size; ++i) {
    std::vector<Values> values;
    if (clean != nullptr) {
      values.push_back({clean->observations()[i], clean->observation_bins()[i], "clean"});
    }
    const bool hidden =
        std::ranges::find(dataset.hidden_dimensions, i) != dataset.hidden_dimensions.end();
    values.push_back({tally.observations()[i], tally.observation_bins()[i], "corrupted", hidden});
    panels.push_back(DimensionPanel(dimensions, i, values));
  }
  return Pages(figure, panels);
}

std::vector<Figure> ActionFigures(const DatasetDescription& dataset, const DatasetTally& tally) {
  const size_t size = tally.actions().size();
  const Figure figure = GridFigure(dataset, "actions", tally.rows(), size);
  const Dimensions dimensions =
      DimensionsOf("action", dataset.environment ? &dataset.environment->action : nullptr, size);
  std::vector<Panel> panels;
  for (size_t i = 0; i < size; ++i) {
    panels.push_back(
        DimensionPanel(dimensions, i, {{tally.actions()[i], tally.action_bins()[i], ""}}));
  }
  return Pages(figure, panels);
}

}  // namespace b4mrl
