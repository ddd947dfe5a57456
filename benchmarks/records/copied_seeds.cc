#include "benchmarks/records/copied_seeds.h"

#include <fmt/format.h>

#include <map>

#include "benchmarks/records/json_file.h"
#include "data/files/file_hash.h"

namespace b4mrl {

nlohmann::ordered_json SeedMarks(const nlohmann::ordered_json& result) {
  nlohmann::ordered_json marks = {{"cell", TextOf(result, "cell")},
                                  {"agent_sha256", TextOf(result, "agent_sha256")}};
  if (const auto seed = CountOf(result, "seed")) marks["seed"] = *seed;
  const auto& curve = EntryOf(result, "curve");
  if (!curve.empty()) marks["curve"] = Sha256OfText(curve.dump());
  return marks;
}

std::vector<std::vector<std::string>> CopiedSeeds(
    const std::vector<nlohmann::ordered_json>& results, const std::vector<std::string>& names) {
  std::vector<std::vector<std::string>> faults(results.size());
  std::map<std::string, size_t> first;  // result by its cell and what two seeds cannot share
  for (size_t i = 0; i < results.size(); ++i) {
    const auto& result = results[i];
    const auto& curve = EntryOf(result, "curve");
    const std::pair<const char*, std::string> shared[] = {
        {"agent", TextOf(result, "agent_sha256")},
        {"curve", curve.empty() ? "" : curve.dump()},
    };
    for (const auto& [what, text] : shared) {
      if (text.empty()) continue;
      const auto [before, is_new] =
          first.emplace(fmt::format("{} {} {}", TextOf(result, "cell"), what, text), i);
      const auto& other = results[before->second];
      if (is_new || CountOf(other, "seed") == CountOf(result, "seed")) continue;
      faults[i].push_back(fmt::format("its {} is that of seed {} in {}", what,
                                      EntryOf(other, "seed").dump(), names[before->second]));
    }
  }
  return faults;
}

}  // namespace b4mrl
