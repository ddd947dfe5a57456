#include "server/perturbations/list.h"

#include <set>
#include <sstream>

#include "data/files/csv_lines.h"
#include "server/environments/list.h"
#include "tests/data/temporary_folder.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

EnvironmentSpec Spec() { return Take(DescribeEnvironment("HalfCheetah")); }

Result<PerturbationSet> TryMake(const std::string& text,
                                PerturbationUse use = PerturbationUse::kSimulator) {
  return MakePerturbations(Take(ParseNamedArguments(text)), Spec(), use);
}

Status Refusal(const std::string& text, PerturbationUse use = PerturbationUse::kSimulator) {
  const auto result = TryMake(text, use);
  REQUIRE_FALSE(result.ok());
  return result.status();
}

std::string Resolved(const std::string& presets, const std::string& environment) {
  const EnvironmentSpec spec = Take(DescribeEnvironment(environment));
  return FormatNamedArguments(
      Take(MakePerturbations(Take(ParseNamedArguments(presets)), spec, PerturbationUse::kSimulator))
          .items());
}

TEST_CASE("Presets have the paper's values, and the delay ours") {
  const std::string noise = "obs-noise-low,obs-noise-high,hidden-low,hidden-high,";
  const std::string actions = "action-noise-low,action-noise-high,action-delay";
  CHECK(Resolved("gravity,friction," + noise + actions, "HalfCheetah") ==
        "gravity=2,friction=0.3,obs-noise=0.01,obs-noise=0.05,"
        "action-noise=0.2,action-noise=0.5,action-delay=2,hidden=16,hidden=9");
  CHECK(Resolved("gravity,leg," + noise + actions, "Hopper") ==
        "gravity=2,leg=0.8,obs-noise=0.001,obs-noise=0.02,"
        "action-noise=0.5,action-noise=1,action-delay=2,hidden=9,hidden=10");
  CHECK(Resolved("gravity,friction," + noise + actions, "Walker2d") ==
        "gravity=2,friction=0.3,obs-noise=0.01,obs-noise=0.03,"
        "action-noise=0.2,action-noise=0.5,action-delay=2,hidden=16,hidden=9");
  CHECK(Resolved("action-delay", "Humanoid") == "action-delay=2");
  CHECK(Resolved("cars," + noise + actions, "Highway") ==
        "cars=15,obs-noise=0.5,obs-noise=1,action-noise=0.5,action-noise=1,action-delay=2,"
        "hidden=3+4+8+9+13+14+18+19+23+24,hidden=2+3+4+7+8+9+12+13+14+17+18+19+22+23+24");
}

TEST_CASE("A preset hides the same quantity under every setting") {
  for (const char* environment : {"HalfCheetah", "Hopper", "Walker2d"}) {
    for (const char* preset : {"hidden-low", "hidden-high"}) {
      CAPTURE(environment, preset);
      const auto hidden_name = [&](const std::string& config) {
        const auto simulator = Take(TryOpen(environment, preset, config));
        const auto hidden =
            Take(HiddenDimensions(simulator->resolved_perturbations(), simulator->spec()));
        REQUIRE(hidden.size() == 1);
        return simulator->spec().observation.dimensions[hidden[0]].name;
      };
      const std::string name = hidden_name("");
      CHECK(hidden_name(R"({"exclude_current_positions_from_observation": false})") == name);
      // The dimensions that a list without resolved presets names are the same ones.
      const auto wider = Take(
          TryOpen(environment, "", R"({"exclude_current_positions_from_observation": false})"));
      const std::vector<NamedArgument> written = {{preset, ""}};
      CHECK(Take(HiddenDimensions(written, wider->spec())) ==
            std::vector<uint32_t>{Take(wider->spec().observation.FindDimension(name))});
    }
  }
}

TEST_CASE("The report's table of the paper's errors says what the presets are") {
  std::istringstream lines(ReadBytes(B4MRL_SOURCE_DIR "/benchmarks/paper_parameters.csv"));
  std::string line;
  std::getline(lines, line);  // the columns' names
  size_t count = 0;
  for (; std::getline(lines, line); ++count) {
    CAPTURE(line);
    const auto cells = CellsOf(line);
    REQUIRE(cells.size() == 5);
    const std::string environment(cells[0]);
    CHECK(Resolved(std::string(cells[1]), environment) ==
          Resolved(std::string(cells[2]), environment));
  }
  CHECK(count == 31);
}

TEST_CASE("Every preset of the table builds in its environment") {
  for (const Preset& preset : PresetList()) {
    INFO(preset.environment << " " << preset.name);
    const std::string form = std::string(preset.parametric) + "=" + std::string(preset.argument);
    const std::string environment(preset.environment);
    REQUIRE(Resolved(std::string(preset.name), environment) == Resolved(form, environment));
  }
}

TEST_CASE(
    "A preset is there or refused with a reason or its parametric form, in each environment") {
  std::set<std::string_view> names;
  for (const Preset& preset : PresetList()) names.insert(preset.name);
  for (const EnvironmentEntry& entry : EnvironmentList()) {
    const EnvironmentSpec spec = Take(DescribeEnvironment(entry.name));
    for (const std::string_view name : names) {
      INFO(entry.name << " " << name);
      const NamedArgument item = {std::string(name), ""};
      const auto made = MakePerturbations({&item, 1}, spec, PerturbationUse::kSimulator);
      if (made.ok()) continue;
      CHECK(made.status().code() == StatusCode::kUnsupported);
      CHECK_THAT(made.status().message(),
                 Catch::Contains("give a value: ") || Catch::Contains("it takes "));
      // What "it takes" or "give a value" proposes can be given.
      if (entry.name == "Highway") {
        CHECK_THAT(made.status().message(), !Catch::Contains("gravity=<"));
      }
    }
  }
}

TEST_CASE("What cannot be applied to an environment is refused with what can") {
  for (const char* item : {"gravity=1.5", "friction=0.3", "leg=0.8", "model=half_cheetah.xml"}) {
    INFO(item);
    const Status status = TryOpen("Highway", item).status();
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK_THAT(status.message(), Catch::Contains("obs-noise=<std>"));
    CHECK_THAT(status.message(), !Catch::Contains("gravity=<factor>"));
  }
  CHECK(TryOpen("HalfCheetah", "cars=3").status().code() == StatusCode::kUnsupported);
}

TEST_CASE("A model is named by a plain file name, once") {
  for (const char* refused : {"model=../x.xml", "model=/etc/x.xml", "model=a/b.xml", "model=.x.xml",
                              "model=x.mjb", "model=.xml", "model=a b.xml"}) {
    INFO(refused);
    CHECK(Refusal(refused).code() == StatusCode::kInvalidArgument);
  }
  CHECK(TryMake("model=My_model-2.xml").ok());
  CHECK(Refusal("model=a.xml,model=b.xml").code() == StatusCode::kInvalidArgument);
  CHECK(Refusal("model=a.xml", PerturbationUse::kDataset).code() == StatusCode::kUnsupported);
  // Only the gateway has files compiled.
  CHECK(TryOpen("HalfCheetah", "model=half_cheetah.xml").status().code() ==
        StatusCode::kUnsupported);
}

TEST_CASE("Parametric forms take any value within their bounds") {
  CHECK(TryMake("gravity=-10").ok());
  CHECK(TryMake("gravity=0").ok());
  CHECK(TryMake("friction=0").ok());
  CHECK(TryMake("obs-noise=0").ok());
  CHECK(TryMake("hidden=0+1+2+3+4+5+6+7+8+9+10+11+12+13+14+15+16").ok());
  CHECK(TryMake("hidden=rootz+v-root-z").ok());
  for (const char* refused : {"gravity=10.1", "gravity=nan", "gravity=inf", "gravity=1x",
                              "friction=-0.1", "friction=101", "obs-noise=-1", "obs-noise=1e7"}) {
    INFO(refused);
    CHECK(Refusal(refused).code() == StatusCode::kInvalidArgument);
  }
  CHECK_THAT(Refusal("gravity=11").message(), Catch::Contains("-10"));
}

TEST_CASE("Dimensions that do not exist are refused") {
  CHECK_FALSE(TryMake("hidden=17").ok());
  CHECK_FALSE(TryMake("hidden=-1").ok());
  CHECK_FALSE(TryMake("hidden=9+").ok());
  CHECK_THAT(Refusal("hidden=v-root-y").message(), Catch::Contains("v-root-"));
}

TEST_CASE("Unknown names are answered with the nearest known one") {
  const Status status = Refusal("gravty");
  REQUIRE(status.code() == StatusCode::kUnknownName);
  REQUIRE_THAT(status.message(), Catch::Contains("'gravity'"));
  REQUIRE_THAT(Refusal("obs-noise-hihg").message(), Catch::Contains("'obs-noise-high'"));
  REQUIRE_THAT(Refusal("frictoin=2").message(), Catch::Contains("'friction'"));
}

TEST_CASE(
    "A preset that an environment lacks is refused with its reason and the parametric forms") {
  const Status leg = Refusal("leg");
  REQUIRE(leg.code() == StatusCode::kUnsupported);
  REQUIRE_THAT(leg.message(), Catch::Contains("lower legs"));
  REQUIRE_THAT(leg.message(), Catch::Contains("gravity=<factor>"));
  REQUIRE_THAT(Refusal("obs-noise").message(), Catch::Contains("obs-noise=<std>"));
  REQUIRE_THAT(Refusal("obs-noise-low=0.3").message(), Catch::Contains("obs-noise=0.3"));
  EnvironmentSpec other = Spec();
  other.name = "Another";
  const NamedArgument gravity = {"gravity", ""};
  const auto result = MakePerturbations({&gravity, 1}, other, PerturbationUse::kSimulator);
  REQUIRE(result.status().code() == StatusCode::kUnsupported);
  REQUIRE_THAT(result.status().message(), Catch::Contains("gravity=<factor>"));
}

TEST_CASE("A dataset takes what corrupts observations and nothing else") {
  CHECK(TryMake("obs-noise-low,hidden=9", PerturbationUse::kDataset).ok());
  CHECK(Refusal("gravity", PerturbationUse::kDataset).code() == StatusCode::kUnsupported);
  CHECK(Refusal("friction=0.5", PerturbationUse::kDataset).code() == StatusCode::kUnsupported);
}

TEST_CASE("There is a limit to how many perturbations apply") {
  std::string text = "gravity=1";
  for (int i = 1; i < 16; ++i) text += ",gravity=1";
  CHECK(TryMake(text).ok());
  CHECK(Refusal(text + ",gravity=1").code() == StatusCode::kInvalidArgument);
}

TEST_CASE("The hidden dimensions of a list are known without building it") {
  const auto hidden = [](const std::string& text) {
    return Take(HiddenDimensions(Take(ParseNamedArguments(text)), Spec()));
  };
  CHECK(hidden("gravity,hidden-low,hidden=v-root-z+3+3") == std::vector<uint32_t>{3, 9, 16});
  CHECK(hidden("obs-noise-low").empty());
}

TEST_CASE("Names in the table are unique and every number's bounds are ordered") {
  std::set<std::string_view> names;
  for (const PerturbationEntry& entry : PerturbationList()) {
    CHECK(names.insert(entry.name).second);
    if (entry.type == "number") CHECK(entry.low < entry.high);
    CHECK_FALSE(entry.description.empty());
  }
}

}  // namespace
}  // namespace b4mrl
