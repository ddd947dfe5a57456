// Users' models as simulators: what fits gives the bits of the same change to the task's own model,
// other perturbations apply to it, and what cannot be played or perturbed is refused.
#include "server/simulator/lane_stepper.h"
#include "tests/server/models/model_folders.h"

namespace b4mrl {
namespace {

struct Task {
  const char* environment;
  const char* file;
};
constexpr Task kTasks[] = {{"HalfCheetah", "half_cheetah.xml"},
                           {"Hopper", "hopper.xml"},
                           {"Walker2d", "walker2d.xml"},
                           {"Humanoid", "humanoid.xml"}};

TEST_CASE("A task's own model, given as a user's, gives the task's own bits") {
  const Folders folders;
  for (const Task& task : kTasks) {
    INFO(task.environment);
    const std::string own = OwnModel(task.file);
    const std::string hash = Take(folders.CompileText(own, task.environment));
    REQUIRE(hash == Take(folders.CompileText(own, task.environment)));
    REQUIRE(folders.CacheFiles().contains(hash + ".mjb"));
    REQUIRE(Walk(Take(folders.TryOpen(task.environment, hash))) ==
            Walk(Take(TryOpen(task.environment))));
  }
  CHECK(folders.CacheFiles().size() == std::size(kTasks));
}

TEST_CASE("An edited file is what the same change of the compiled model is") {
  const Folders folders;
  const std::string hash = Take(folders.CompileText(EditedHopper("0 0 -9.81", "0 0 -19.62")));
  const uint64_t edited = Walk(Take(folders.TryOpen("Hopper", hash)));
  CHECK(edited == Walk(Take(TryOpen("Hopper", "gravity=2"))));
  CHECK(edited != Walk(Take(TryOpen("Hopper"))));
}

TEST_CASE("Walker2d's own file with the left foot's friction on the right is version 5") {
  const Folders folders;
  const std::string version_5 = R"({"version": "v5"})";
  const auto walk = [&](const std::string& text) {
    const std::string hash = Take(folders.CompileText(text, "Walker2d"));
    return Walk(Take(folders.TryOpen("Walker2d", hash, "model=model.xml", version_5)));
  };
  const std::string own = OwnModel("walker2d.xml");
  const std::string foot = "geom name=\"foot_geom\"";
  const uint64_t wanted = Walk(Take(TryOpen("Walker2d", "", version_5)));
  CHECK(walk(Edited(own, foot, foot + " friction=\"1.9 0.1 0.1\"")) == wanted);
  CHECK(walk(own) != wanted);  // a user's model is taken as it is
}

TEST_CASE("Other perturbations change the user's model, wherever it stands among them") {
  const Folders folders;
  const std::string hash = Take(folders.CompileText(EditedHopper("0 0 -9.81", "0 0 -19.62")));
  CHECK(Walk(Take(folders.TryOpen("Hopper", hash, "friction=0.5,model=model.xml,leg=0.8"))) ==
        Walk(Take(TryOpen("Hopper", "gravity=2,friction=0.5,leg=0.8"))));
}

TEST_CASE("Friction changes pairs of geoms with coefficients of their own") {
  const Folders folders;
  const auto walk = [&](const std::string& text, const std::string& factor) {
    const std::string hash = Take(folders.CompileText(text));
    return Walk(Take(folders.TryOpen("Hopper", hash, "model=model.xml,friction=" + factor)));
  };
  const auto with_pair = [](const std::string& text, const std::string& friction) {
    const std::string pair = "<pair geom1=\"floor\" geom2=\"foot_geom\" condim=\"6\" friction=\"" +
                             friction + "\" margin=\"0.001\"/>";
    return Edited(text, "<actuator>", "<contact>" + pair + "</contact><actuator>");
  };
  // Halves are exact in binary, so the two are equal to the last bit.
  std::string halved =
      EditedHopper("friction=\"0.9 0.005 0.0001\"", "friction=\"0.45 0.0025 5e-5\"");
  halved = Edited(halved, "friction=\"1 0.005 0.0001\"", "friction=\"0.5 0.0025 5e-5\"");
  halved = Edited(halved, "friction=\"2 0.005 0.0001\"", "friction=\"1 0.0025 5e-5\"");
  const std::string pair = with_pair(OwnModel("hopper.xml"), "2 1.5 0.3 0.1 0.2");
  CHECK(walk(pair, "0.5") == walk(with_pair(halved, "1 0.75 0.15 0.05 0.1"), "1"));
  CHECK(walk(pair, "0.5") != walk(pair, "1"));
}

TEST_CASE("A perturbation that the user's model has no parts for is refused with their names") {
  const Folders folders;
  const std::string hash =
      Take(folders.CompileText(EditedHopper("geom name=\"leg_geom\"", "geom name=\"shank\"")));
  const Status status = folders.TryOpen("Hopper", hash, "model=model.xml,leg=0.8").status();
  REQUIRE(status.code() == StatusCode::kUnsupported);
  CHECK_THAT(status.message(), Catch::Contains("leg_geom"));
}

TEST_CASE("A compiled copy that has changed on disk is refused") {
  const Folders folders;
  const std::string hash = Take(folders.CompileText(OwnModel("hopper.xml")));
  const std::string path = CompiledModelPath(folders.cache, hash);
  std::string bytes = ReadBytes(path);
  bytes[bytes.size() / 2] ^= 1;
  WriteBytes(path, bytes);
  CHECK(folders.TryOpen("Hopper", hash).status().code() == StatusCode::kDataLoss);
}

TEST_CASE("Joints with names of the user's own are taken in their order") {
  const Folders folders;
  std::string text = EditedHopper("<joint name=\"thigh_joint\"", "<joint name=\"hip\"");
  text = Edited(text, "joint=\"thigh_joint\"", "joint=\"hip\"");
  CHECK(Walk(Take(folders.TryOpen("Hopper", Take(folders.CompileText(text))))) ==
        Walk(Take(TryOpen("Hopper"))));
}

TEST_CASE("A model that is unhealthy from its start on is no environment, unless settings say so") {
  const Folders folders;
  // Without `ref`, the height counts from the start and not from the floor.
  const std::string hash = Take(folders.CompileText(EditedHopper(" ref=\"1.25\"", "")));
  const auto status = [&](const std::string& config) {
    const auto simulator = Take(folders.TryOpen("Hopper", hash, "model=model.xml", config));
    const Status found = LaneStepper::Create(simulator, AutoresetMode::kNextStep).status();
    // It is remembered, and not asked for by those who take sessions over.
    CHECK(LaneStepper::Create(simulator, AutoresetMode::kNextStep).status().ToString() ==
          found.ToString());
    CHECK(LaneStepper::Create(simulator, AutoresetMode::kNextStep, StartCheck::kSkipped).ok());
    return found;
  };
  const Status refused = status("");
  INFO(refused.ToString());
  CHECK(refused.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(refused.message(), Catch::Contains("model.xml starts at qpos = (0, 0, 0, ...)"));
  CHECK(status(R"({"healthy_z_range": [-0.5, null]})").ok());
  CHECK(status(R"({"terminate_when_unhealthy": false})").ok());
}

}  // namespace
}  // namespace b4mrl
