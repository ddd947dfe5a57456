// leg=FACTOR: the lower legs of the Hopper and the Walker2d, shortened or stretched. Preset: 0.8
// for the Hopper; the paper names the factor and leaves its meaning open, so this reading is ours:
//
//   The cylinder of the capsule between knee and ankle gets FACTOR times its length. Its radius and
//   density stay, a user's model's too, so that mass and inertia follow. The knee stays where it is
//   on the thigh; ankle and foot move along the leg, so that all joints stay connected. The torso
//   starts lower or higher by the difference, so that the sole hangs as far above the floor as
//   before, and qpos[1] is still the torso's height above the floor. Healthy heights and the reward
//   are unchanged.
//
// Lengths are rounded to 1e-12 m and densities to 12 digits, as somebody would write them into the
// MJCF (0.3 for 0.25 * 0.8 + 0.1), which makes the result equal to the compiled model of such a
// file, bit by bit. The model's quantities that follow from masses and lengths are derived by
// MuJoCo itself (mj_setConst).
#include <fmt/format.h>
#include <mujoco/mujoco.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <string>

#include "server/environments/mujoco/mujoco_guard.h"
#include "server/environments/mujoco/mujoco_model.h"
#include "server/perturbations/list.h"

namespace b4mrl {
namespace {

// Rounds to 1e-12 m, through decimal text, since 3e11 * 1e-12 is not the double nearest to 0.3.
double Rounded(double metres) {
  return std::strtod(fmt::format("{:.12f}", metres).c_str(), nullptr);
}

// MuJoCo ids of one lower leg's body, geom, knee joint and foot body.
struct Leg {
  int body = -1, geom = -1, knee = -1, foot = -1;
};

// MuJoCo ids of the body above the legs and of the joints that carry it.
struct Torso {
  int body = -1, rootx = -1, rootz = -1;
};

// A body that is one capsule along z, of even density. Inertia is about its centre, kg m^2.
struct Capsule {
  double mass = 0;  // kg
  std::array<double, 3> inertia{};
};

double VolumeOf(double radius, double half_length) {
  const double height = 2 * half_length;
  return mjPI * (radius * radius * height + 4 * radius * radius * radius / 3);
}

// In the order of MuJoCo's own operations.
Capsule MakeCapsule(double radius, double half_length, double density) {
  const double height = 2 * half_length;
  Capsule capsule;
  capsule.mass = density * VolumeOf(radius, half_length);
  const double ends = capsule.mass * 4 * radius / (4 * radius + 3 * height);
  const double cylinder = capsule.mass - ends;
  const double ends_inertia = 2 * ends * radius * radius / 5;
  auto& inertia = capsule.inertia;
  inertia[0] = cylinder * (3 * radius * radius + height * height) / 12;
  inertia[0] += ends_inertia + ends * height * (3 * radius + 2 * height) / 8;
  inertia[1] = inertia[0];
  inertia[2] = cylinder * radius * radius / 2 + ends_inertia;
  return capsule;
}

// The density of the leg's capsule, kg/m^3. kUnsupported if the body's mass is not spread like that
// of its capsule: then nothing says what a longer leg weighs.
Result<double> DensityOf(const mjModel& model, const Leg& leg) {
  const double* size = model.geom_size + 3 * leg.geom;
  const double mass = model.body_mass[leg.body];
  const double exact = mass / VolumeOf(size[0], size[1]);
  const double density = std::strtod(fmt::format("{:.12g}", exact).c_str(), nullptr);
  const Capsule capsule = MakeCapsule(size[0], size[1], density);
  // Far above rounding, far below a difference that somebody would write down.
  constexpr double kTolerance = 1e-9;
  const double* turn = model.geom_quat + 4 * leg.geom;
  const double cosine = 1 - 2 * (turn[1] * turn[1] + turn[2] * turn[2]);  // of its axis with z
  bool even = std::abs(cosine) >= 1 - kTolerance;
  for (int i = 0; i < 3; ++i) {
    const double centre = model.geom_pos[3 * leg.geom + i];
    even = even && std::abs(model.body_ipos[3 * leg.body + i] - centre) <= kTolerance &&
           std::abs(model.body_inertia[3 * leg.body + i] - capsule.inertia[i]) <=
               kTolerance * capsule.inertia[0];
  }
  if (even) return density;
  return Status(StatusCode::kUnsupported,
                fmt::format("leg needs a model whose body {} has the mass and inertia of a "
                            "capsule along z, without an <inertial> of its own",
                            mj_id2name(&model, mjOBJ_BODY, leg.body)));
}

class LegLength final : public NumberPerturbation {
 public:
  using NumberPerturbation::NumberPerturbation;

  // A model that does not fit is refused with factor 1, too: it is the largest of `leg=0.6..1`,
  // which opening tries out for all of them.
  Status OnModel(mjModel* model, double factor) const override {
    const bool resizes = factor != 1;
    double shortened = 0;
    for (const char* suffix : {"", "_left"}) {
      Leg leg{};
      B4MRL_ASSIGN_OR_RETURN(const bool found, FindLeg(*model, suffix, &leg));
      if (!found) continue;
      B4MRL_ASSIGN_OR_RETURN(const double density, DensityOf(*model, leg));
      if (resizes) shortened = Resize(leg, factor, density, model);
    }
    B4MRL_ASSIGN_OR_RETURN(const Torso torso, FindTorso(*model));
    if (!resizes) return Status();
    LowerTorso(torso, shortened, model);
    return Derive(model);
  }

 private:
  // False if the model has no leg with this suffix; without the first leg, an error.
  static Result<bool> FindLeg(const mjModel& model, const std::string& suffix, Leg* leg) {
    const auto find = [&](mjtObj type, const std::string& name) {
      return mj_name2id(&model, type, name.c_str());
    };
    leg->body = find(mjOBJ_BODY, "leg" + suffix);
    if (leg->body < 0 && !suffix.empty()) return false;
    leg->foot = find(mjOBJ_BODY, "foot" + suffix);
    leg->geom = find(mjOBJ_GEOM, "leg" + suffix + "_geom");
    leg->knee = find(mjOBJ_JOINT, "leg" + suffix + "_joint");
    const bool whole = leg->body >= 0 && leg->foot >= 0 && leg->geom >= 0 && leg->knee >= 0 &&
                       model.geom_type[leg->geom] == mjGEOM_CAPSULE &&
                       model.body_geomnum[leg->body] == 1 &&
                       model.body_parentid[leg->foot] == leg->body;
    if (whole) return true;
    return Status(StatusCode::kUnsupported,
                  fmt::format("leg needs a model with the bodies leg{0} and foot{0}, the joint "
                              "leg{0}_joint and the capsule leg{0}_geom",
                              suffix));
  }

  // Resizes one lower leg; returns by how much the distance from knee to ankle shrinks, in m.
  static double Resize(const Leg& leg, double factor, double density, mjModel* model) {
    double* size = model->geom_size + 3 * leg.geom;
    const double before = size[1];
    const double after = Rounded(before * factor);
    size[1] = after;
    model->geom_rbound[leg.geom] = size[0] + after;
    const Capsule capsule = MakeCapsule(size[0], after, density);
    model->body_mass[leg.body] = capsule.mass;
    std::ranges::copy(capsule.inertia, model->body_inertia + 3 * leg.body);
    const double change = before - after;  // of each half of the cylinder, m
    double& leg_z = model->body_pos[3 * leg.body + 2];
    double& knee_z = model->jnt_pos[3 * leg.knee + 2];
    double& foot_z = model->body_pos[3 * leg.foot + 2];
    leg_z = Rounded(leg_z + change);
    knee_z = Rounded(knee_z - change);
    foot_z = Rounded(foot_z + change);
    return 2 * change;
  }

  static Result<Torso> FindTorso(const mjModel& model) {
    const Torso torso = {mj_name2id(&model, mjOBJ_BODY, "torso"),
                         mj_name2id(&model, mjOBJ_JOINT, "rootx"),
                         mj_name2id(&model, mjOBJ_JOINT, "rootz")};
    if (torso.body >= 0 && torso.rootx >= 0 && torso.rootz >= 0) return torso;
    return Status(StatusCode::kUnsupported,
                  "leg needs a model with the body torso and the joints rootx and rootz");
  }

  static void LowerTorso(const Torso& torso, double distance, mjModel* model) {
    const double height = Rounded(model->body_pos[3 * torso.body + 2] - distance);
    model->body_pos[3 * torso.body + 2] = height;
    model->qpos0[model->jnt_qposadr[torso.rootz]] = height;
    for (const int joint : {torso.rootx, torso.rootz}) model->jnt_pos[3 * joint + 2] = -height;
  }

  static Status Derive(mjModel* model) {
    B4MRL_ASSIGN_OR_RETURN(const MjDataPtr data, MakeMujocoData(*model));
    if (RunGuarded([&] { mj_setConst(model, data.get()); })) return Status();
    return Status(StatusCode::kUnsupported,
                  fmt::format("leg does not fit this model: {}", LastMujocoError()));
  }
};

constexpr Preset kPresets[] = {{"leg", "Hopper", "leg", "0.8"}};

}  // namespace

extern const PerturbationEntry kLegLength;  // its line in list.cc
constinit const PerturbationEntry kLegLength = {
    .name = "leg",
    .parameter = "factor",
    .type = "number",
    .low = 0.25,  // then the torso starts at 0.875 m; the Walker2d falls below 0.8 m
    .high = 2,
    .takes_range = true,
    .description =
        "multiplies the length of the lower legs; the torso starts lower by the same length",
    .needs = kLowerLegs,
    .presets = kPresets,
    .make = MakeNumberPerturbation<LegLength>};

}  // namespace b4mrl
