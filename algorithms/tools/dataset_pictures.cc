#include "algorithms/tools/dataset_pictures.h"

#include <fmt/format.h>

#include <optional>
#include <utility>

#include "algorithms/base/progress.h"
#include "algorithms/pictures/dataset_figures.h"
#include "algorithms/pictures/dataset_tally.h"
#include "algorithms/tools/dataset_source.h"
#include "data/files/atomic_file.h"
#include "data/files/make_folder.h"

namespace b4mrl {
namespace {

// A dataset and what was counted of it.
struct Counted {
  RemoteDataset& dataset;
  DatasetTally tally{dataset.observation_size(), dataset.action_size()};
};

// Hands all rows of the dataset to the tally's `pass`, which is Measure or Count.
Status ReadRows(Counted& counted, void (DatasetTally::*pass)(const RowBlock&), Progress* progress,
                uint64_t* done) {
  return ForEachRows(counted.dataset, [&](const TransitionRows& read) {
    (counted.tally.*
     pass)({read.observations, read.actions, read.rewards, read.terminals, read.timeouts});
    progress->Update(*done += read.rows);
    return Status();
  });
}

// Reads the dataset, and the same one without its corruption if there is one, in both passes.
Status CountRows(Counted& counted, Counted* clean, bool quiet) {
  Progress progress(quiet);
  const uint64_t rows = counted.dataset.rows() + (clean != nullptr ? clean->dataset.rows() : 0);
  progress.Start("pictures", "rows", 2 * rows);
  uint64_t done = 0;
  for (const auto pass : {&DatasetTally::Measure, &DatasetTally::Count}) {
    if (pass == &DatasetTally::Count) {
      counted.tally.PrepareBins(clean != nullptr ? &clean->tally : nullptr);
      if (clean != nullptr) clean->tally.PrepareBins(&counted.tally);
    }
    B4MRL_RETURN_IF_ERROR(ReadRows(counted, pass, &progress, &done));
    if (clean != nullptr) B4MRL_RETURN_IF_ERROR(ReadRows(*clean, pass, &progress, &done));
  }
  return Status();
}

// "obs-noise=0.1", with " (corruption seed 1)" unless the seed is 0, the default and the seed of
// corruptions that draw nothing; "" without corruptions.
std::string CorruptionWords(const pb::OpenDatasetReply& opened) {
  std::string words;
  for (const pb::NamedArgument& item : opened.corruptions()) {
    if (!words.empty()) words += ", ";
    words += NamedArgument{item.name(), item.argument()}.ToString();
  }
  return opened.seed() == 0 ? words : fmt::format("{} (corruption seed {})", words, opened.seed());
}

// Writes figures as NAME.svg, NAME-2.svg, ... and adds their paths to `paths`.
Status WriteFigures(const std::vector<Figure>& figures, const std::string& folder,
                    const std::string& name, std::vector<std::string>* paths) {
  for (size_t i = 0; i < figures.size(); ++i) {
    const std::string number = i == 0 ? "" : fmt::format("-{}", i + 1);
    paths->push_back(fmt::format("{}/{}{}.svg", folder, name, number));
    B4MRL_RETURN_IF_ERROR(WriteSmallFile(paths->back(), RenderSvg(figures[i])));
  }
  return Status();
}

}  // namespace

Result<std::vector<std::string>> WriteDatasetPictures(Client& client, RemoteDataset& dataset,
                                                      const std::string& folder, bool quiet) {
  B4MRL_RETURN_IF_ERROR(MakeFolder(folder));
  const pb::OpenDatasetReply& opened = dataset.in_force();
  DatasetDescription description;
  description.name = opened.info().name();
  description.corruption = CorruptionWords(opened);
  description.hidden_dimensions.assign(opened.hidden_dimensions().begin(),
                                       opened.hidden_dimensions().end());
  // An unknown environment is no error: its dimensions have no names.
  if (auto spec = client.FindEnvironment(dataset.environment()); spec.ok()) {
    description.environment = std::move(*spec);
  }
  Counted counted{dataset};
  std::optional<RemoteDataset> source;
  std::optional<Counted> clean;
  if (!opened.corruptions().empty()) {
    DatasetOptions options;
    options.transition_rule = opened.transition_rule();
    B4MRL_ASSIGN_OR_RETURN(source, client.OpenDataset(description.name, options));
    clean.emplace(Counted{*source});
  }
  B4MRL_RETURN_IF_ERROR(CountRows(counted, clean ? &*clean : nullptr, quiet));

  std::vector<std::string> paths;
  const DatasetTally& tally = counted.tally;
  B4MRL_RETURN_IF_ERROR(
      WriteFigures({ReturnsFigure(description, tally)}, folder, "returns", &paths));
  B4MRL_RETURN_IF_ERROR(
      WriteFigures(ObservationFigures(description, tally, clean ? &clean->tally : nullptr), folder,
                   "observations", &paths));
  B4MRL_RETURN_IF_ERROR(WriteFigures(ActionFigures(description, tally), folder, "actions", &paths));
  return paths;
}

}  // namespace b4mrl
