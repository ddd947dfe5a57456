#include "algorithms/datasets/published_datasets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "data/files/toml_file.h"
#include "proto/base/folders.h"

namespace b4mrl {
namespace {

std::vector<std::string> Texts(const toml::table& table, std::string_view name) {
  std::vector<std::string> texts;
  if (const toml::array* array = table[name].as_array()) {
    for (const toml::node& node : *array) texts.push_back(node.value_or(std::string()));
  }
  return texts;
}

PublishedDataset FromTable(const toml::table& table) {
  PublishedDataset out;
  out.recipe = table["recipe"].value_or(std::string());
  out.policies_sha256 = Texts(table, "policies_sha256");
  out.seeds = Texts(table, "seeds");
  out.rows = static_cast<uint64_t>(table["rows"].value_or(int64_t{0}));
  out.columns_sha256 = table["columns_sha256"].value_or(std::string());
  out.mean_return = table["mean_return"].value_or(0.0);
  out.std_return = table["std_return"].value_or(0.0);
  out.normalised_score = table["normalised_score"].value<double>();
  out.engine = table["engine"].value_or(std::string());
  out.license = table["license"].value_or(std::string());
  return out;
}

}  // namespace

Result<PublishedDatasets> ReadPublishedDatasets(const std::string& path) {
  B4MRL_ASSIGN_OR_RETURN(const toml::table all, ReadTomlFile(path));
  PublishedDatasets datasets;
  for (const auto& [key, value] : all) {
    const toml::table* table = value.as_table();
    const std::string name(key.str());
    if (table == nullptr) return InvalidArgument(path, name, "tables named after datasets");
    PublishedDataset dataset = FromTable(*table);
    if (dataset.rows == 0 || dataset.columns_sha256.size() != 64) {
      return InvalidArgument(path, name, "an entry with rows and columns_sha256");
    }
    datasets.emplace(name, std::move(dataset));
  }
  return datasets;
}

Result<PublishedDatasets> ReadPublishedDatasets() {
  return ReadPublishedDatasets(SharedFolder("", B4MRL_DATA_FOLDER) + "/datasets.toml");
}

const PublishedDataset* PublishedOtherwise(const PublishedDatasets& published,
                                           std::string_view name, std::string_view columns_sha256) {
  const auto found = published.find(name);
  const bool is_other = found != published.end() && found->second.columns_sha256 != columns_sha256;
  return is_other ? &found->second : nullptr;
}

std::vector<std::string> Differences(const Recording& made, const PublishedDataset& published) {
  if (made.summary.columns_sha256 == published.columns_sha256) return {};
  std::vector<std::string> lines;
  const auto compare = [&](std::string_view subject, const std::string& ours,
                           const std::string& theirs) {
    if (ours != theirs) {
      lines.push_back(fmt::format("{}: {}, published: {}", subject, ours, theirs));
    }
  };
  std::vector<std::string> policies;
  for (const RecordedPart& part : made.provenance.parts) policies.push_back(part.policy_sha256);
  compare("SHA-256 of the behaviour policy", fmt::format("{}", fmt::join(policies, ", ")),
          fmt::format("{}", fmt::join(published.policies_sha256, ", ")));
  compare("engine", made.provenance.engine, published.engine);
  compare("rows", fmt::format("{}", made.summary.rows), fmt::format("{}", published.rows));
  compare("mean return", fmt::format("{:.6g}", made.summary.mean_return),
          fmt::format("{:.6g}", published.mean_return));
  compare("SHA-256 of the columns", made.summary.columns_sha256, published.columns_sha256);
  return lines;
}

}  // namespace b4mrl
