// Models of users in their sandboxed process: what does not fit is refused with its reason, and
// nothing ends the parent or is left behind.
#include "server/models/model_compiler.h"

#include <sys/stat.h>

#include "proto/base/limits.h"
#include "proto/base/rng.h"
#include "server/environments/mujoco/compiled_model.h"
#include "tests/data/file_size_limit.h"
#include "tests/server/models/model_folders.h"

namespace b4mrl {
namespace {

// A file, and what its refusal names.
struct BadModel {
  const char* what;
  std::string text;
  const char* named;
};

std::vector<BadModel> BadModels() {
  const std::string motor = "<motor name=\"foot\" joint=\"foot_joint\"/>";
  const std::string rooty = "<joint name=\"rooty\" class=\"root\" axis=\"0 1 0\"/>";
  const std::string size = "<size njmax=\"120\" nconmax=\"40\" nstack=\"40000\"/>";
  return {
      {"not XML", "<mujoco>\n<worldbody>\n</mujoco>", "line"},
      {"unknown attribute", "<mujoco>\n<worldbody>\n<geom sise='1'/></worldbody></mujoco>",
       "line 3"},
      {"compiler error", "<mujoco>\n<worldbody>\n<geom size='-1'/></worldbody></mujoco>",
       "line = 3"},
      {"no joints", "<mujoco/>", "joints"},
      {"an actuator less", EditedHopper(motor, ""), "actuators"},
      {"a joint less", EditedHopper(rooty, ""), "joints"},
      {"another joint type",
       EditedHopper(rooty, "<joint name=\"rooty\" class=\"root\" type=\"ball\"/>"),
       "type of joint 2"},
      {"joints in another order",
       EditedHopper(
           "name=\"rootx\" class=\"root\" type=\"slide\" axis=\"1 0 0\" pos=\"0 0 -1.25\"/>\n"
           "      <joint name=\"rootz\"",
           "name=\"rootz\" class=\"root\" type=\"slide\" axis=\"1 0 0\" pos=\"0 0 -1.25\"/>\n"
           "      <joint name=\"rootx\""),
       "joint 0 of model.xml is 'rootz', allowed: rootx"},
      {"motors in another order",
       EditedHopper("<motor name=\"thigh\" joint=\"thigh_joint\"/>\n    <motor name=\"leg\" "
                    "joint=\"leg_joint\"/>",
                    "<motor name=\"leg\" joint=\"leg_joint\"/><motor name=\"thigh\" "
                    "joint=\"thigh_joint\"/>"),
       "joint of actuator 0 of model.xml is 'leg_joint', allowed: thigh_joint"},
      {"two motors of one joint", EditedHopper(motor, "<motor joint=\"leg_joint\"/>"),
       "joint of actuator 2 of model.xml is 'leg_joint'"},
      {"another timestep", EditedHopper("timestep=\"0.002\"", "timestep=\"0.001\""), "timestep"},
      {"actuators with a state",
       EditedHopper(motor, "<general joint=\"foot_joint\" dyntype=\"filter\"/>"), "states"},
      {"user data", EditedHopper(size, "<size nuserdata=\"3\"/>"), "nuserdata"},
      {"an absolute include", "<mujoco>\n<include file='/etc/passwd'/></mujoco>", "line 2"},
      {"a mesh outside", EditedHopper("<asset>", "<asset><mesh file='../x.stl'/>"), "../x.stl"},
      {"a mesh that is not there", EditedHopper("<asset>", "<asset><mesh file='x.stl'/>"), "x.stl"},
      {"itself included", "<mujoco><include file='model.xml'/></mujoco>", "model.xml"},
      {"a body without mass",
       EditedHopper("geom name=\"leg_geom\"", "geom name=\"leg_geom\" mass=\"0\""), "mass"},
      {"NaN", EditedHopper("0 0 -9.81", "0 0 nan"), ""},
      {"an endless explosion", EditedHopper("0 0 -9.81", "0 0 -1e300"), ""},
      {"too deep",
       [] {
         std::string text = "<mujoco>";
         for (int i = 0; i < 100'000; ++i) text += "<a>";
         return text;
       }(),
       "line"},
      {"too long", "<mujoco/>" + std::string(limits::kMaxModelFileBytes, ' '), "longer"},
  };
}

[[maybe_unused]] std::vector<BadModel> Bombs() {
  const std::string size = "<size njmax=\"120\" nconmax=\"40\" nstack=\"40000\"/>";
  const std::string world = "<worldbody>";
  return {
      {"a giant stack", EditedHopper(size, "<size nstack=\"2000000000\"/>"), "536870912 bytes"},
      {"a large stack", EditedHopper(size, "<size nstack=\"20000000\"/>"), "nstack"},
      {"many constraints", EditedHopper(size, "<size njmax=\"50000\"/>"), ""},
      {"a giant texture",
       EditedHopper("<asset>",
                    "<asset><texture name=\"t\" type=\"2d\" builtin=\"flat\" width=\"40000\" "
                    "height=\"40000\"/>"),
       ""},
      {"a large texture",
       EditedHopper("<asset>",
                    "<asset><texture name=\"t\" type=\"2d\" builtin=\"flat\" width=\"4000\" "
                    "height=\"4000\"/>"),
       "bytes"},
      {"a million bodies",
       EditedHopper(world,
                    world + "<body><composite type=\"box\" count=\"100 100 100\" spacing=\"0.01\">"
                            "<geom size=\"0.004\"/></composite></body>"),
       ""},
  };
}

void CheckRefused(const std::vector<BadModel>& models) {
  const Folders folders;
  for (const BadModel& bad : models) {
    const auto compiled = folders.CompileText(bad.text);
    INFO(bad.what << ": " << compiled.status().ToString());
    CHECK_FALSE(compiled.ok());
    CHECK_THAT(compiled.status().message(), Catch::Contains("model=model.xml"));
    CHECK_THAT(compiled.status().message(), Catch::Contains(bad.named));
    CHECK(compiled.status().code() != StatusCode::kInternal);
  }
  CHECK(folders.CacheFiles().empty());
}

TEST_CASE("A bad file is refused with its reason, costs nobody anything and leaves nothing") {
  CheckRefused(BadModels());
}

// Sanitizers need addresses without bound, so the sandbox gives them no limit of memory.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST_CASE("A file that asks for absurd sizes is refused before it has them") {
  CheckRefused(Bombs());
}

// A client tries again where the daemon says that it helps.
TEST_CASE("A model that is too large is refused for good") {
  const Folders folders;
  for (const BadModel& bad : Bombs()) {
    if (!std::string_view(bad.what).starts_with("a large ")) continue;  // the others may take long
    const Status refused = folders.CompileText(bad.text).status();
    INFO(bad.what << ": " << refused.ToString());
    CHECK(refused.code() == StatusCode::kInvalidArgument);
    CHECK_FALSE(refused.recoverable());
  }
}
#endif

TEST_CASE("A model for another task is refused in this one and taken in that one") {
  const Folders folders;
  const std::string walker = OwnModel("walker2d.xml");
  CHECK_THAT(folders.CompileText(walker, "Hopper").status().message(), Catch::Contains("joints"));
  CHECK(folders.CompileText(walker, "Walker2d").ok());
  // As many joints and motors, but of other kinds or steps.
  CHECK_FALSE(folders.CompileText(walker, "HalfCheetah").ok());
}

TEST_CASE("A user's model with too many bodies is named, not the task's own") {
  const Folders folders;
  const Status status = folders
                            .CompileText(Edited(OwnModel("humanoid.xml"), "<worldbody>",
                                                "<worldbody><body name=\"box\" pos=\"9 9 1\">"
                                                "<geom type=\"sphere\" size=\"0.1\"/></body>"),
                                         "Humanoid")
                            .status();
  INFO(status.ToString());
  CHECK(status.code() == StatusCode::kInvalidArgument);
  CHECK_THAT(status.message(), Catch::Contains("model.xml has") && Catch::Contains("bodies"));
}

TEST_CASE("A compiled model for which the disk has no room is an error of the disk") {
  const Folders folders;
  const std::string model = folders.models + "/model.xml", compiled = folders.cache + "/x.mjb";
  WriteBytes(model, OwnModel("hopper.xml"));
  {
    const FileSizeLimit full(16 * 1024);
    CHECK(CompileModelFile(model, compiled).status().code() == StatusCode::kIoError);
  }
  CHECK(CompileModelFile(model, compiled).ok());
}

TEST_CASE("A file that is not there, or no file, is refused") {
  const Folders folders;
  WriteBytes(folders.models + "/heavy_torso.xml", OwnModel("hopper.xml"));
  const Status missing = folders.Compile("heavy_tors.xml", "Hopper").status();
  CHECK(missing.code() == StatusCode::kUnknownName);
  CHECK_THAT(missing.message(), Catch::Contains("'heavy_torso.xml'"));
  REQUIRE(mkfifo((folders.models + "/pipe.xml").c_str(), 0644) == 0);
  CHECK(folders.Compile("pipe.xml", "Hopper").status().code() == StatusCode::kInvalidArgument);
  REQUIRE(mkdir((folders.models + "/folder.xml").c_str(), 0755) == 0);
  CHECK_FALSE(folders.Compile("folder.xml", "Hopper").ok());
  CHECK_FALSE(folders.Compile("../models/heavy_torso.xml", "Hopper").ok());
}

TEST_CASE("The folder's files that can be named are listed") {
  const Folders folders;
  for (const char* name : {"b.xml", "a.xml", ".hidden.xml", "c.txt", "with space.xml"}) {
    WriteBytes(folders.models + "/" + name, "");
  }
  REQUIRE(mkdir((folders.models + "/d.xml").c_str(), 0755) == 0);
  CHECK(ListModelFiles(folders.models) == std::vector<std::string>{"a.xml", "b.xml"});
  CHECK(ListModelFiles("/nonexistent").empty());
}

// The Hopper with a few bytes changed, removed or repeated.
std::string Mutated(std::string text, Rng* rng) {
  for (uint64_t i = 0; i <= rng->Below(8); ++i) {
    const size_t at = rng->Below(text.size());
    const uint64_t kind = rng->Below(5);
    if (kind == 0) text[at] = static_cast<char>(rng->Below(256));
    if (kind == 1) text.erase(at, rng->Below(60));
    if (kind == 2) text.insert(at, text.substr(rng->Below(text.size()), rng->Below(400)));
    // Digits give numbers of other sizes.
    if (kind == 3) text[at] = "0123456789-e."[rng->Below(13)];
    if (kind == 4 && text.find_first_of("0123456789", at) != std::string::npos) {
      text.insert(text.find_first_of("0123456789", at), "9");
    }
    if (text.empty()) text = " ";
  }
  return text;
}

void CompileMutants(uint64_t count) {
  const Folders folders;
  uint64_t accepted = 0;
  for (uint64_t i = 0; i < count; ++i) {
    Rng rng(i, "model-mutant");
    const auto compiled = folders.CompileText(Mutated(OwnModel("hopper.xml"), &rng));
    INFO("mutant " << i << ": " << compiled.status().ToString());
    accepted += compiled.ok();
    CHECK(compiled.status().code() != StatusCode::kInternal);
    CHECK(compiled.status().code() != StatusCode::kDeadlineExceeded);
  }
  // Some changes are harmless, most are not; either extreme would test nothing.
  CHECK(accepted > 0);
  CHECK(accepted < count);
  for (const std::string& name : folders.CacheFiles()) CHECK(name.ends_with(".mjb"));
}

TEST_CASE("Mutated models are taken or refused") { CompileMutants(40); }

TEST_CASE("Thousands of mutated models are taken or refused", "[.][long]") { CompileMutants(4000); }

}  // namespace
}  // namespace b4mrl
