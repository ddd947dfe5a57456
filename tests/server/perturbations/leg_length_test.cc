// The shortened leg against models whose text was edited: the two must compile to equal bytes.
#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "server/environments/mujoco/mujoco_model.h"
#include "server/perturbations/list.h"
#include "tests/data/temporary_folder.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

struct Task {
  const char* environment;
  const char* file;
  int legs;
};
constexpr Task kTasks[] = {{"Hopper", "hopper.xml", 1}, {"Walker2d", "walker2d.xml", 2}};

// Names a number wherever it stands in the model's text, and how often.
void Replace(std::string* text, const std::string& before, const std::string& after, int times) {
  int found = 0;
  for (size_t at = 0; (at = text->find(before, at)) != std::string::npos; at += after.size()) {
    text->replace(at, before.size(), after);
    ++found;
  }
  INFO(before);
  REQUIRE(found == times);
}

// The model with legs of `factor` times their length, as somebody would write it.
std::string EditedText(const Task& task, double factor) {
  std::ifstream file(DefaultModelsFolder() + "/" + task.file);
  std::string text(std::istreambuf_iterator<char>(file), {});
  const double half = 0.25 * factor;
  const double height = 1.25 - 2 * (0.25 - half);
  const auto replace = [&](const std::string& before, const std::string& after, int times) {
    Replace(&text, before, after, times);
  };
  replace("pos=\"0 0 -0.70000000000000007\"", fmt::format("pos=\"0 0 {:.12g}\"", -0.45 - half),
          task.legs);
  replace("pos=\"0 0 0.25\"", fmt::format("pos=\"0 0 {:.12g}\"", half), task.legs);
  replace("size=\"0.04 0.25\"", fmt::format("size=\"0.04 {:.12g}\"", half), task.legs);
  replace(" 0 -0.35\"", fmt::format(" 0 {:.12g}\"", -half - 0.1), task.legs);
  replace("pos=\"0 0 1.25\"", fmt::format("pos=\"0 0 {:.12g}\"", height), 1);
  replace("pos=\"0 0 -1.25\"", fmt::format("pos=\"0 0 {:.12g}\"", -height), 2);
  replace("ref=\"1.25\"", fmt::format("ref=\"{:.12g}\"", height), 1);
  return text;
}

std::string BytesOf(const mjModel& model) {
  std::string bytes(static_cast<size_t>(mj_sizeModel(&model)), '\0');
  mj_saveModel(&model, nullptr, bytes.data(), static_cast<int>(bytes.size()));
  return bytes;
}

MjModelPtr Compiled(const std::string& path) {
  char error[1000] = "";
  MjModelPtr model(mj_loadXML(path.c_str(), nullptr, error, sizeof(error)));
  INFO(error);
  REQUIRE(model != nullptr);
  return model;
}

MjModelPtr Perturbed(const Task& task, const std::string& perturbations) {
  const EnvironmentSpec spec = Take(DescribeEnvironment(task.environment));
  const PerturbationSet set = Take(MakePerturbations(Take(ParseNamedArguments(perturbations)), spec,
                                                     PerturbationUse::kSimulator));
  const auto change = [&](std::span<const double> parameters, mjModel* model) {
    return set.OnModel(parameters, model);
  };
  return Take(LoadMujocoModel({.config = Config::object(), .change_model = change}, task.file))
      .model;
}

TEST_CASE("A leg of any length is the compiled model of the edited file, byte for byte") {
  for (const Task& task : kTasks) {
    for (const double factor : {0.8, 0.25, 0.5, 0.93, 1.1, 2.0}) {
      CAPTURE(task.environment, factor);
      const TemporaryFolder folder;
      WriteBytes(folder.File(task.file), EditedText(task, factor));
      const MjModelPtr edited = Compiled(folder.File(task.file));
      const MjModelPtr perturbed = Perturbed(task, fmt::format("leg={}", factor));
      REQUIRE((BytesOf(*edited) == BytesOf(*perturbed)));
    }
  }
}

// The compiled model of `text`, with a leg of `factor` times its length.
Result<MjModelPtr> CompiledWithLeg(const Task& task, const std::string& text, double factor) {
  const TemporaryFolder folder;
  WriteBytes(folder.File(task.file), text);
  MjModelPtr model = Compiled(folder.File(task.file));
  const EnvironmentSpec spec = Take(DescribeEnvironment(task.environment));
  const std::vector<NamedArgument> leg = {{"leg", fmt::format("{}", factor)}};
  const PerturbationSet set = Take(MakePerturbations(leg, spec, PerturbationUse::kSimulator));
  B4MRL_RETURN_IF_ERROR(set.OnModel({}, model.get()));
  return model;
}

TEST_CASE("A leg of a user's density keeps it, byte for byte") {
  for (const Task& task : kTasks) {
    INFO(task.environment);
    const auto heavy = [&](double factor) {
      std::string text = EditedText(task, factor);
      Replace(&text, "geom name=\"leg_geom\"", "geom name=\"leg_geom\" density=\"2710.5\"", 1);
      return text;
    };
    const MjModelPtr model = Take(CompiledWithLeg(task, heavy(1), 0.8));
    const TemporaryFolder folder;
    WriteBytes(folder.File(task.file), heavy(0.8));
    CHECK((BytesOf(*model) == BytesOf(*Compiled(folder.File(task.file)))));
    CHECK((BytesOf(*model) != BytesOf(*Perturbed(task, "leg=0.8"))));
  }
}

TEST_CASE("A leg whose mass is not spread like a capsule's along z is refused") {
  const Task& task = kTasks[0];
  const std::string joint = "<joint name=\"leg_joint\"";
  const auto status = [&](double z, double mass, double inertia) {
    std::string text = EditedText(task, 1);
    Replace(&text, "inertiafromgeom=\"true\"", "inertiafromgeom=\"auto\"", 1);
    const MjModelPtr own = Perturbed(task, "");
    const int leg = mj_name2id(own.get(), mjOBJ_BODY, "leg");
    const double* of_own = own->body_inertia + 3 * leg;
    Replace(
        &text, joint,
        fmt::format("<inertial pos=\"0 0 {}\" mass=\"{}\" diaginertia=\"{} {} {}\"/>{}", z,
                    mass * own->body_mass[leg], inertia * of_own[0], of_own[1], of_own[2], joint),
        1);
    return CompiledWithLeg(task, text, 0.8).status();
  };
  RequireOk(status(0, 1, 1));  // written down, the capsule's own numbers are an even capsule's
  for (const Status& refused : {status(0.01, 1, 1), status(0, 1.01, 1), status(0, 1, 1.01)}) {
    INFO(refused.ToString());
    CHECK(refused.code() == StatusCode::kUnsupported);
    CHECK_THAT(refused.message(), Catch::Contains("body leg"));
  }
  std::string tilted = EditedText(task, 1);
  Replace(&tilted, "geom name=\"leg_geom\"", "geom name=\"leg_geom\" axisangle=\"0 1 0 20\"", 1);
  CHECK(CompiledWithLeg(task, tilted, 0.8).status().code() == StatusCode::kUnsupported);
}

TEST_CASE("The Hopper's preset has the masses and the start of the definition") {
  const MjModelPtr model = Perturbed(kTasks[0], "leg");
  const int leg = mj_name2id(model.get(), mjOBJ_BODY, "leg");
  // A capsule of 1,000 kg/m^3 with r 0.04 m and h 0.2 m; the digits are MuJoCo's own for such a
  // file.
  CHECK(model->body_mass[leg] == 2.2787018714037965);
  CHECK(model->body_inertia[3 * leg] == 0.04011587623963109);
  CHECK(model->body_inertia[3 * leg + 2] == 0.001780068285426025);
  CHECK(model->body_subtreemass[0] == 15.317358581352636);
  CHECK(model->stat.meaninertia == 8.117483099262932);
  CHECK(model->qpos0[1] == 1.15);
}

TEST_CASE("A leg of its own length changes nothing, and two factors multiply") {
  for (const Task& task : kTasks) {
    INFO(task.environment);
    REQUIRE((BytesOf(*Perturbed(task, "leg=1")) == BytesOf(*Perturbed(task, ""))));
    const MjModelPtr twice = Perturbed(task, "leg=0.5,leg=1.6");
    const MjModelPtr once = Perturbed(task, "leg=0.8");
    const int leg = mj_name2id(once.get(), mjOBJ_BODY, "leg");
    CHECK(twice->body_mass[leg] == Approx(once->body_mass[leg]).epsilon(1e-12));  // rounding
    CHECK(twice->qpos0[1] == Approx(once->qpos0[1]).epsilon(1e-12));
  }
}

TEST_CASE("A model without the legs is refused for a leg of its own length, too") {
  for (const Task& task : kTasks) {
    std::string text = EditedText(task, 1);
    Replace(&text, "geom name=\"leg_geom\"", "geom name=\"shank\"", 1);
    for (const double factor : {1.0, 0.8}) {
      INFO(fmt::format("{}, leg={}", task.environment, factor));
      const auto refused = CompiledWithLeg(task, text, factor);
      REQUIRE(refused.status().code() == StatusCode::kUnsupported);
      CHECK_THAT(refused.status().message(), Catch::Contains("capsule leg_geom"));
    }
  }
}

TEST_CASE("The sole starts as far above the floor and the task judges as before") {
  for (const Task& task : kTasks) {
    INFO(task.environment);
    TestLane nominal(Take(TryOpen(task.environment, "", R"({"reset_noise_scale": 0})")));
    TestLane shortened(Take(TryOpen(task.environment, "leg=0.8", R"({"reset_noise_scale": 0})")));
    nominal.Reset();
    shortened.Reset();
    // Observation 0 is the torso's height.
    CHECK(nominal.observation()[0] - shortened.observation()[0] == Approx(0.1).epsilon(1e-12));
    shortened.StepRandomly(0);
    CHECK(shortened.header().terminated == 0);
  }
}

TEST_CASE("Environments without such a leg refuse it") {
  for (const char* environment : {"HalfCheetah", "Humanoid", "Highway"}) {
    INFO(environment);
    const Status status = TryOpen(environment, "leg=0.8").status();
    CHECK(status.code() == StatusCode::kUnsupported);
    CHECK(status.message().find("leg=0.8") != std::string::npos);
  }
}

}  // namespace
}  // namespace b4mrl
