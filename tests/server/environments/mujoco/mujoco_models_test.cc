// The compiled models against the recorded ones, field by field, without tolerance.
#include <algorithm>
#include <catch2/catch.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>

#include "server/environments/mujoco/mujoco_environment.h"
#include "server/environments/mujoco/own_models.h"
#include "server/perturbations/list.h"
#include "tests/data/temporary_folder.h"
#include "tests/server/environments/simulation.h"

namespace b4mrl {
namespace {

using nlohmann::json;

struct Task {
  const char* environment;
  const char* name;  // of the files
};
constexpr Task kTasks[] = {{"HalfCheetah", "half_cheetah"},
                           {"Hopper", "hopper"},
                           {"Walker2d", "walker2d"},
                           {"Humanoid", "humanoid"}};

json Reference(const Task& task) {
  std::ifstream file(std::string(B4MRL_SOURCE_DIR) + "/tests/reference/" + task.name +
                     "_model.json");
  return json::parse(file);
}

MjModelPtr Load(const Task& task, const std::string& perturbations) {
  const EnvironmentSpec spec = Take(DescribeEnvironment(task.environment));
  const PerturbationSet set = Take(MakePerturbations(Take(ParseNamedArguments(perturbations)), spec,
                                                     PerturbationUse::kSimulator));
  const auto change = [&](std::span<const double> parameters, mjModel* model) {
    return set.OnModel(parameters, model);
  };
  return Take(LoadMujocoModel({.config = Config::object(), .change_model = change},
                              std::string(task.name) + ".xml"))
      .model;
}

// Compares arrays of the model with the reference and remembers which fields were compared.
class Comparison {
 public:
  Comparison(const Task& task, const mjModel& model) : model_(model), reference_(Reference(task)) {}

  // The recording has the field only where it means something.
  bool Has(const std::string& field) const { return reference_.contains(field); }

  template <typename T>
  void Array(const std::string& field, const T* values, int count) {
    INFO(field);
    const json& expected = Expected(field);
    REQUIRE(expected.size() == static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
      INFO("entry " << i);
      // digits17 text and back is exact
      REQUIRE(double(values[i]) == expected[i].get<double>());
    }
  }
  void Scalar(const std::string& field, double value) {
    INFO(field);
    REQUIRE(value == Expected(field).get<double>());
  }
  void Names(const std::string& field, mjtObj type, int count) {
    INFO(field);
    const json& expected = Expected(field);
    REQUIRE(expected.size() == static_cast<size_t>(count));
    for (int i = 0; i < count; ++i) {
      REQUIRE(std::string(mj_id2name(&model_, type, i)) == expected[i].get<std::string>());
    }
  }
  std::set<std::string> Missed() const {
    std::set<std::string> missed;
    for (const auto& [field, value] : reference_.items()) {
      if (!seen_.contains(field)) missed.insert(field);
    }
    return missed;
  }
  const json& Expected(const std::string& field) {
    seen_.insert(field);
    return reference_.at(field);
  }

 private:
  const mjModel& model_;
  json reference_;
  std::set<std::string> seen_;
};

void CompareOptions(const mjModel& m, Comparison& c) {
  c.Scalar("timestep", m.opt.timestep);
  c.Scalar("apirate", m.opt.apirate);
  c.Array("gravity", m.opt.gravity, 3);
  c.Array("wind", m.opt.wind, 3);
  c.Array("magnetic", m.opt.magnetic, 3);
  c.Scalar("density", m.opt.density);
  c.Scalar("viscosity", m.opt.viscosity);
  c.Scalar("impratio", m.opt.impratio);
  c.Scalar("tolerance", m.opt.tolerance);
  c.Scalar("noslip_tolerance", m.opt.noslip_tolerance);
  c.Scalar("mpr_tolerance", m.opt.mpr_tolerance);
  c.Scalar("o_margin", m.opt.o_margin);
  c.Array("o_solref", m.opt.o_solref, mjNREF);
  c.Array("o_solimp", m.opt.o_solimp, mjNIMP);
  c.Scalar("integrator", m.opt.integrator);
  c.Scalar("collision", m.opt.collision);
  c.Scalar("cone", m.opt.cone);
  c.Scalar("jacobian", m.opt.jacobian);
  c.Scalar("solver", m.opt.solver);
  c.Scalar("iterations", m.opt.iterations);
  c.Scalar("noslip_iterations", m.opt.noslip_iterations);
  c.Scalar("mpr_iterations", m.opt.mpr_iterations);
  c.Scalar("disableflags", m.opt.disableflags);
  c.Scalar("enableflags", m.opt.enableflags);
  c.Scalar("stat_meaninertia", m.stat.meaninertia);
  c.Scalar("stat_meanmass", m.stat.meanmass);
  c.Scalar("stat_meansize", m.stat.meansize);
  c.Scalar("stat_extent", m.stat.extent);
  c.Array("stat_center", m.stat.center, 3);
}

void CompareBodies(const mjModel& m, Comparison& c) {
  c.Array("qpos0", m.qpos0, m.nq);
  c.Array("qpos_spring", m.qpos_spring, m.nq);
  c.Names("body_names", mjOBJ_BODY, m.nbody);
  c.Array("body_parentid", m.body_parentid, m.nbody);
  c.Array("body_mass", m.body_mass, m.nbody);
  c.Array("body_subtreemass", m.body_subtreemass, m.nbody);
  c.Array("body_inertia", m.body_inertia, 3 * m.nbody);
  c.Array("body_pos", m.body_pos, 3 * m.nbody);
  c.Array("body_quat", m.body_quat, 4 * m.nbody);
  c.Array("body_ipos", m.body_ipos, 3 * m.nbody);
  c.Array("body_iquat", m.body_iquat, 4 * m.nbody);
  c.Array("body_invweight0", m.body_invweight0, 2 * m.nbody);
}

void CompareJoints(const mjModel& m, Comparison& c) {
  c.Names("jnt_names", mjOBJ_JOINT, m.njnt);
  c.Array("jnt_type", m.jnt_type, m.njnt);
  c.Array("jnt_qposadr", m.jnt_qposadr, m.njnt);
  c.Array("jnt_dofadr", m.jnt_dofadr, m.njnt);
  c.Array("jnt_bodyid", m.jnt_bodyid, m.njnt);
  c.Array("jnt_limited", m.jnt_limited, m.njnt);
  c.Array("jnt_axis", m.jnt_axis, 3 * m.njnt);
  c.Array("jnt_pos", m.jnt_pos, 3 * m.njnt);
  c.Array("jnt_stiffness", m.jnt_stiffness, m.njnt);
  c.Array("jnt_margin", m.jnt_margin, m.njnt);
  c.Array("jnt_solref", m.jnt_solref, mjNREF * m.njnt);
  c.Array("jnt_solimp", m.jnt_solimp, mjNIMP * m.njnt);
  std::vector<double> ranges;
  for (int i = 0; i < m.njnt; ++i) {
    if (m.jnt_limited[i]) ranges.insert(ranges.end(), {m.jnt_range[2 * i], m.jnt_range[2 * i + 1]});
  }
  c.Array("jnt_range_of_limited_joints", ranges.data(), static_cast<int>(ranges.size()));
  c.Array("dof_damping", m.dof_damping, m.nv);
  c.Array("dof_armature", m.dof_armature, m.nv);
  c.Array("dof_frictionloss", m.dof_frictionloss, m.nv);
  c.Array("dof_invweight0", m.dof_invweight0, m.nv);
  c.Array("dof_M0", m.dof_M0, m.nv);
  c.Array("dof_solref", m.dof_solref, mjNREF * m.nv);
  c.Array("dof_solimp", m.dof_solimp, mjNIMP * m.nv);
}

void CompareGeoms(const mjModel& m, Comparison& c) {
  c.Names("geom_names", mjOBJ_GEOM, m.ngeom);
  c.Array("geom_type", m.geom_type, m.ngeom);
  c.Array("geom_bodyid", m.geom_bodyid, m.ngeom);
  c.Array("geom_size", m.geom_size, 3 * m.ngeom);
  c.Array("geom_pos", m.geom_pos, 3 * m.ngeom);
  c.Array("geom_quat", m.geom_quat, 4 * m.ngeom);
  c.Array("geom_friction", m.geom_friction, 3 * m.ngeom);
  c.Array("geom_condim", m.geom_condim, m.ngeom);
  c.Array("geom_contype", m.geom_contype, m.ngeom);
  c.Array("geom_conaffinity", m.geom_conaffinity, m.ngeom);
  c.Array("geom_margin", m.geom_margin, m.ngeom);
  c.Array("geom_gap", m.geom_gap, m.ngeom);
  c.Array("geom_solref", m.geom_solref, mjNREF * m.ngeom);
  c.Array("geom_solimp", m.geom_solimp, mjNIMP * m.ngeom);
  c.Array("geom_solmix", m.geom_solmix, m.ngeom);
  c.Array("geom_priority", m.geom_priority, m.ngeom);
  c.Array("geom_rbound", m.geom_rbound, m.ngeom);
}

void CompareActuators(const mjModel& m, Comparison& c) {
  if (c.Has("actuator_names")) c.Names("actuator_names", mjOBJ_ACTUATOR, m.nu);
  c.Array("actuator_trntype", m.actuator_trntype, m.nu);
  c.Array("actuator_trnid", m.actuator_trnid, 2 * m.nu);
  c.Array("actuator_dyntype", m.actuator_dyntype, m.nu);
  c.Array("actuator_gaintype", m.actuator_gaintype, m.nu);
  c.Array("actuator_biastype", m.actuator_biastype, m.nu);
  c.Array("actuator_gear", m.actuator_gear, 6 * m.nu);
  c.Array("actuator_ctrllimited", m.actuator_ctrllimited, m.nu);
  c.Array("actuator_ctrlrange", m.actuator_ctrlrange, 2 * m.nu);
  c.Array("actuator_forcelimited", m.actuator_forcelimited, m.nu);
  // The recording keeps the first entries of the parameter vectors.
  const int gain_entries = static_cast<int>(c.Expected("actuator_gainprm").size()) / m.nu;
  const int bias_entries = static_cast<int>(c.Expected("actuator_biasprm").size()) / m.nu;
  std::vector<double> gain, bias;
  for (int i = 0; i < m.nu; ++i) {
    gain.insert(gain.end(), m.actuator_gainprm + i * mjNGAIN,
                m.actuator_gainprm + i * mjNGAIN + gain_entries);
    bias.insert(bias.end(), m.actuator_biasprm + i * mjNBIAS,
                m.actuator_biasprm + i * mjNBIAS + bias_entries);
  }
  c.Array("actuator_gainprm", gain.data(), static_cast<int>(gain.size()));
  c.Array("actuator_biasprm", bias.data(), static_cast<int>(bias.size()));
  c.Array("actuator_acc0", m.actuator_acc0, m.nu);
}

void CompareTendons(const mjModel& m, Comparison& c) {
  if (!c.Has("ntendon")) return;
  c.Scalar("ntendon", m.ntendon);
  c.Names("tendon_names", mjOBJ_TENDON, m.ntendon);
  c.Array("tendon_adr", m.tendon_adr, m.ntendon);
  c.Array("tendon_num", m.tendon_num, m.ntendon);
  c.Array("wrap_objid", m.wrap_objid, m.nwrap);
  c.Array("wrap_prm", m.wrap_prm, m.nwrap);
  c.Array("tendon_limited", m.tendon_limited, m.ntendon);
  c.Array("tendon_stiffness", m.tendon_stiffness, m.ntendon);
  c.Array("tendon_damping", m.tendon_damping, m.ntendon);
  c.Array("tendon_length0", m.tendon_length0, m.ntendon);
}

TEST_CASE("The models in the program are the files of data/models") {
  for (const Task& task : kTasks) {
    const std::string file = std::string(task.name) + ".xml";
    CHECK(OwnModel(file) == ReadBytes(B4MRL_SOURCE_DIR "/data/models/" + file));
  }
  CHECK(OwnModel("no_such.xml").empty());
}

TEST_CASE("Every compiled model equals the recorded one in every field") {
  for (const Task& task : kTasks) {
    INFO(task.name);
    const MjModelPtr model = Load(task, "");
    Comparison comparison(task, *model);
    for (const auto& [name, size] : {std::pair<const char*, int>{"nq", model->nq},
                                     {"nv", model->nv},
                                     {"nu", model->nu},
                                     {"na", model->na},
                                     {"nbody", model->nbody},
                                     {"njnt", model->njnt},
                                     {"ngeom", model->ngeom}}) {
      comparison.Scalar(name, size);
    }
    CompareOptions(*model, comparison);
    CompareBodies(*model, comparison);
    CompareJoints(*model, comparison);
    CompareGeoms(*model, comparison);
    CompareActuators(*model, comparison);
    CompareTendons(*model, comparison);
    REQUIRE(comparison.Missed() == std::set<std::string>{"geom_friction_times_0.3"});
  }
}

// Every byte of a compiled model.
std::string BytesOf(const mjModel& model) {
  std::string bytes(mj_sizeModel(&model), '\0');
  mj_saveModel(&model, nullptr, bytes.data(), static_cast<int>(bytes.size()));
  return bytes;
}

TEST_CASE("friction scales every coefficient of every geom and nothing else") {
  for (const Task& task : kTasks) {
    INFO(task.name);
    const MjModelPtr model = Load(task, "friction=0.3");
    const MjModelPtr plain = Load(task, "");
    REQUIRE(BytesOf(*plain) != BytesOf(*model));
    std::copy_n(model->geom_friction, 3 * model->ngeom, plain->geom_friction);
    REQUIRE(BytesOf(*plain) == BytesOf(*model));
    Comparison comparison(task, *model);
    // Scaling by 0.3 rounds once; the recording was scaled by the same product.
    comparison.Array("geom_friction_times_0.3", model->geom_friction, 3 * model->ngeom);
  }
}

TEST_CASE("gravity doubles gravity and nothing else") {
  for (const Task& task : kTasks) {
    INFO(task.name);
    const MjModelPtr model = Load(task, "gravity=2");
    REQUIRE(model->opt.gravity[0] == 0);
    REQUIRE(model->opt.gravity[1] == 0);
    REQUIRE(model->opt.gravity[2] == -19.62);
    const MjModelPtr plain = Load(task, "");
    plain->opt.gravity[2] = -19.62;
    REQUIRE(BytesOf(*plain) == BytesOf(*model));
  }
}

TEST_CASE("A perturbed model leaves the shared one as it was") {
  const MjModelPtr perturbed = Load(kTasks[0], "gravity=0.5,friction=2");
  REQUIRE(perturbed->geom_friction[0] == 0.8);
  const MjModelPtr plain = Load(kTasks[0], "");
  REQUIRE(plain->opt.gravity[2] == -9.81);
  REQUIRE(plain->geom_friction[0] == 0.4);
}

}  // namespace
}  // namespace b4mrl
