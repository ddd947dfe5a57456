#include "server/environments/mujoco/collision_pairs.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "proto/base/rng.h"
#include "server/environments/mujoco/mujoco_model.h"
#include "tests/data/temporary_folder.h"
#include "tests/results.h"

namespace b4mrl {
namespace {

MjModelPtr CompileText(const std::string& body, const std::string& more = "") {
  const TemporaryFolder folder;
  const std::string path = folder.File("model.xml");
  std::ofstream(path) << "<mujoco><worldbody>" << body << "</worldbody>" << more << "</mujoco>";
  char error[1000] = "";
  MjModelPtr model(mj_loadXML(path.c_str(), nullptr, error, sizeof(error)));
  INFO(error);
  REQUIRE(model != nullptr);
  return model;
}

// A copy of `model` with its pairs listed, and what they are.
LoadedModel WithPairs(const mjModel& model) {
  LoadedModel copy{MjModelPtr(mj_copyModel(nullptr, &model)), "", {}};
  copy.pairs = ListCollisionPairs(copy.model.get());
  return copy;
}

template <typename T>
bool EqualBytes(const T* a, const T* b, int count) {
  return std::memcmp(a, b, sizeof(T) * static_cast<size_t>(count)) == 0;
}

bool EqualContacts(const mjContact& a, const mjContact& b) {
  return a.dist == b.dist && EqualBytes(a.pos, b.pos, 3) && EqualBytes(a.frame, b.frame, 9) &&
         a.includemargin == b.includemargin && EqualBytes(a.friction, b.friction, 5) &&
         EqualBytes(a.solref, b.solref, mjNREF) && EqualBytes(a.solimp, b.solimp, mjNIMP) &&
         a.dim == b.dim && a.geom1 == b.geom1 && a.geom2 == b.geom2;
}

// Steps both models with equal random pushes and compares every contact; returns how many.
int RequireEqualSteps(const mjModel& searched, const mjModel& listed, int steps, double push) {
  const MjDataPtr a = Take(MakeMujocoData(searched));
  const MjDataPtr b = Take(MakeMujocoData(listed));
  Rng rng(1, "collision-pairs-test");
  int contacts = 0;
  for (int step = 0; step < steps; ++step) {
    for (int i = 0; i < searched.nv; ++i) {
      const double force = push * rng.Uniform(-1, 1);
      a->qfrc_applied[i] = b->qfrc_applied[i] = force;
    }
    mj_step(&searched, a.get());
    mj_step(&listed, b.get());
    REQUIRE(a->ncon == b->ncon);
    for (int i = 0; i < a->ncon; ++i) REQUIRE(EqualContacts(a->contact[i], b->contact[i]));
    REQUIRE(EqualBytes(a->qpos, b->qpos, searched.nq));
    REQUIRE(EqualBytes(a->qvel, b->qvel, searched.nv));
    contacts += a->ncon;
  }
  return contacts;
}

TEST_CASE("Every task's model touches the same with its pairs listed") {
  const std::pair<const char*, int> tasks[] = {
      {"half_cheetah.xml", 8}, {"hopper.xml", 7}, {"walker2d.xml", 7}, {"humanoid.xml", 126}};
  for (const auto& [file, pairs] : tasks) {
    INFO(file);
    const LoadedModel loaded = Take(LoadMujocoModel({Config::object(), {}}, file));
    const LoadedModel listed = WithPairs(*loaded.model);
    REQUIRE(listed.model->npair == pairs);
    REQUIRE(RequireEqualSteps(*loaded.model, *listed.model, 2000, 30) > 1000);
  }
}

constexpr const char* kPile = R"(
  <geom type="plane" size="5 5 1" friction="0.4 0.02 0.003" solmix="3" condim="1"/>
  <geom type="box" size="0.2 0.2 0.2" pos="0.9 0 0.1" solref="-900 -20"/>
  <body pos="0 0 0.5"><freejoint/>
    <geom type="box" size="0.1 0.2 0.1" solimp="0.8 0.9 0.01 0.4 3" friction="1.5 0.1 0.1"/>
    <geom type="sphere" size="0.1" pos="0.2 0 0" condim="6" margin="0.02" gap="0.01"/>
    <body pos="0.4 0 0"><joint/><geom type="capsule" size="0.05 0.3" solmix="0"/>
      <body pos="0.5 0 0"><geom type="ellipsoid" size="0.2 0.1 0.1" solref="0.05 0.7"/></body>
      <body pos="0.4 0 0.3"><joint/><geom type="sphere" size="0.2" condim="4"/></body>
    </body>
  </body>
  <body pos="0 0 1"><freejoint/><geom type="cylinder" size="0.2 0.2" solmix="0"/></body>
  <body pos="0.1 0 1.6"><freejoint/>
    <geom type="sphere" size="0.3" contype="2" conaffinity="3"/>
  </body>
  <body pos="0.3 0.1 2.3"><freejoint/>
    <geom type="capsule" size="0.1 0.2" contype="4" conaffinity="1"/>
  </body>
)";

TEST_CASE("Contact parameters are mixed as the engine mixes them") {
  const MjModelPtr model = CompileText(kPile);
  const LoadedModel listed = WithPairs(*model);
  REQUIRE(listed.model->npair > 20);
  REQUIRE(RequireEqualSteps(*model, *listed.model, 3000, 5) > 3000);
}

TEST_CASE("The parent's filter may be off") {
  const MjModelPtr model = CompileText(kPile, "<option><flag filterparent='disable'/></option>");
  const LoadedModel listed = WithPairs(*model);
  REQUIRE(listed.model->npair > WithPairs(*CompileText(kPile)).pairs.size());
  REQUIRE(RequireEqualSteps(*model, *listed.model, 1000, 5) > 1000);
}

TEST_CASE("The engine's own search remains where a list would not be the same or too long") {
  const std::string spheres = R"(<body pos="0 0 1"><freejoint/><geom name="a" size="0.1"/></body>
                                 <body pos="0 0 2"><freejoint/><geom name="b" size="0.1"/></body>)";
  const auto stays = [](const MjModelPtr& model) {
    const LoadedModel same = WithPairs(*model);
    return same.model->npair == model->npair && same.model->opt.collision == model->opt.collision;
  };
  CHECK_FALSE(stays(CompileText(spheres)));
  CHECK(stays(CompileText(spheres, "<contact><pair geom1='a' geom2='b'/></contact>")));
  CHECK(stays(CompileText(spheres, "<option collision='dynamic'/>")));
  CHECK(stays(CompileText(spheres + "<geom size='0.1' priority='1'/>")));
  std::string crowd;
  for (int i = 0; i < 24; ++i) {  // 276 pairs
    crowd += "<body pos='" + std::to_string(i) + " 0 1'><freejoint/><geom size='0.1'/></body>";
  }
  CHECK(stays(CompileText(crowd)));
}

}  // namespace
}  // namespace b4mrl
