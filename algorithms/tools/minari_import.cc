#include "algorithms/tools/minari_import.h"

#include <fmt/format.h>

#include <string_view>
#include <utility>

#include "algorithms/base/progress.h"
#include "client/interrupt.h"
#include "data/d4rl/dataset_file_writer.h"
#include "data/minari/minari_reader.h"

namespace b4mrl {
namespace {

// "HalfCheetah" and "v5" of "HalfCheetah-v5"; no version for an id without one.
std::pair<std::string_view, std::string_view> SplitVersion(std::string_view gymnasium_id) {
  const size_t dash = gymnasium_id.rfind("-v");
  if (dash == std::string_view::npos) return {gymnasium_id, ""};
  return {gymnasium_id.substr(0, dash), gymnasium_id.substr(dash + 1)};
}

// The daemon's environment that is the task of the dataset's; "" if there is none. Versions whose
// observations have other sizes, as Humanoid-v5's, are other tasks.
std::string EnvironmentOf(const MinariReader& source, Client& client) {
  const std::string name(SplitVersion(source.metadata().gymnasium_id).first);
  const auto environment = client.FindEnvironment(name);
  const bool same = environment.ok() &&
                    environment->observation.size() == source.observation_size() &&
                    environment->action.size() == source.action_size();
  return same ? name : "";
}

// How the rows of a dataset of others were made, as far as it says.
std::string RecipeOf(const MinariMetadata& metadata, uint64_t unfinished) {
  std::string recipe = fmt::format("Minari's dataset {}", metadata.id);
  if (!metadata.gymnasium_id.empty()) {
    recipe += fmt::format(", recorded in Gymnasium's {}", metadata.gymnasium_id);
  }
  if (unfinished > 0) {
    recipe += fmt::format("; its {} unfinished episodes end by time-out here", unfinished);
  }
  if (!metadata.gymnasium_kwargs.empty()) {
    recipe += fmt::format("; the environment's arguments were {}", metadata.gymnasium_kwargs);
  }
  // The arguments are ASCII, so that no character is cut.
  return recipe.size() <= kMaxProvenanceText ? recipe : recipe.substr(0, kMaxProvenanceText);
}

void ReportVersion(const std::string& gymnasium_id, const std::string& environment) {
  const std::string_view version = SplitVersion(gymnasium_id).second;
  if (environment.empty() || version < "v5") return;
  fmt::print(stderr,
             "recorded in Gymnasium's {}; the daemon's {} is v4 unless its setting \"version\" "
             "says \"v5\"\n",
             gymnasium_id, environment);
}

}  // namespace

Status ConvertMinari(const std::string& data_folder, const std::string& path, Client& client,
                     bool quiet) {
  B4MRL_ASSIGN_OR_RETURN(const MinariReader source, MinariReader::Open(data_folder));
  const MinariMetadata& metadata = source.metadata();
  DatasetWriterOptions options;
  options.observation_dimensions = source.observation_size();
  options.action_dimensions = source.action_size();
  B4MRL_ASSIGN_OR_RETURN(DatasetWriter writer, DatasetWriter::Create(path, options));
  Progress progress(quiet);
  progress.Start("convert", "rows", metadata.rows);
  uint64_t unfinished = 0;
  B4MRL_RETURN_IF_ERROR(source.CopyTo(writer, &unfinished, [&](uint64_t rows) {
    progress.Update(rows);
    return Interrupted() ? Status(StatusCode::kUnavailable, "interrupted") : Status();
  }));
  progress.Update(metadata.rows);
  progress.Finish();
  DatasetProvenance provenance = metadata.provenance;
  if (provenance.environment.empty()) {
    provenance.environment = EnvironmentOf(source, client);
    if (provenance.recipe.empty()) provenance.recipe = RecipeOf(metadata, unfinished);
    if (!quiet) ReportVersion(metadata.gymnasium_id, provenance.environment);
  }
  B4MRL_RETURN_IF_ERROR(writer.SetProvenance(provenance));
  B4MRL_RETURN_IF_ERROR(writer.SetMetadata("source", metadata.id));
  if (!metadata.algorithm.empty()) {
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("behaviour_policy", metadata.algorithm));
  }
  if (metadata.d4rl_transitions) {
    B4MRL_RETURN_IF_ERROR(writer.SetMetadata("transitions", "d4rl"));
  }
  return writer.Commit(Existing::kKeep);
}

}  // namespace b4mrl
