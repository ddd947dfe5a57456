// Humanoid: a torso, free in space, with two arms and two legs: 24 coordinates (x, y, z, quaternion
// and 17 joints), 23 velocities, 17 torque motors, 67 steps a second.
//   observation  qpos without x and y, qvel, cinert, cvel, qfrc_actuator, cfrc_ext, nothing
//                clipped. Version 4: 376 numbers. Version 5 leaves out the world body and the
//                root's actuator forces, which are always 0: 348; with_... settings leave out more.
//   progress     of the centre of mass, from xipos
//   healthy      height in healthy_z_range
//   reward       locomotion.h; version 5 subtracts a contact cost: contact_cost_weight *
//                sum(cfrc_ext^2), clipped to contact_cost_range
//   reset        qpos0 + U(-s, s), the quaternion's entries too (mj_forward normalises it), qvel =
//                U(-s, s); s = reset_noise_scale
//
// What MuJoCo derives (cinert, cvel, cfrc_ext, the centre of mass) is never brought up to date
// after a step, as in Gymnasium, and so belongs to a stage before the state (see
// mujoco_environment.h). These numbers are therefore parts of the state: the observation shows
// them, and the next reward starts from the centre of mass.
#include <algorithm>
#include <string>

#include "server/environments/mujoco/locomotion.h"

namespace b4mrl {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

constexpr const char* kBodies[] = {
    "world",           "torso",           "lwaist",         "pelvis",        "right-thigh",
    "right-shin",      "right-foot",      "left-thigh",     "left-shin",     "left-foot",
    "right-upper-arm", "right-lower-arm", "left-upper-arm", "left-lower-arm"};
constexpr const char* kJoints[] = {
    "abdomen-z",      "abdomen-y",       "abdomen-x",       "right-hip-x", "right-hip-z",
    "right-hip-y",    "right-knee",      "left-hip-x",      "left-hip-z",  "left-hip-y",
    "left-knee",      "right-shoulder1", "right-shoulder2", "right-elbow", "left-shoulder1",
    "left-shoulder2", "left-elbow"};
constexpr const char* kMotors[] = {
    "abdomen-y",      "abdomen-z",       "abdomen-x",       "right-hip-x", "right-hip-z",
    "right-hip-y",    "right-knee",      "left-hip-x",      "left-hip-z",  "left-hip-y",
    "left-knee",      "right-shoulder1", "right-shoulder2", "right-elbow", "left-shoulder1",
    "left-shoulder2", "left-elbow"};

// The part of a dimension's name that follows the body's or joint's name, and the dimension's unit.
using Component = std::pair<const char*, const char*>;
constexpr Component kRootVelocities[] = {{"v-root-x", "m/s"},   {"v-root-y", "m/s"},
                                         {"v-root-z", "m/s"},   {"w-root-x", "rad/s"},
                                         {"w-root-y", "rad/s"}, {"w-root-z", "rad/s"}};
// Inertia of a body (cinert) about the humanoid's centre of mass, in world axes.
constexpr Component kInertia[] = {
    {"ixx", "kg m^2"}, {"iyy", "kg m^2"}, {"izz", "kg m^2"}, {"ixy", "kg m^2"}, {"ixz", "kg m^2"},
    {"iyz", "kg m^2"}, {"mdx", "kg m"},   {"mdy", "kg m"},   {"mdz", "kg m"},   {"mass", "kg"}};
constexpr Component kVelocity[] = {{"wx", "rad/s"}, {"wy", "rad/s"}, {"wz", "rad/s"},
                                   {"vx", "m/s"},   {"vy", "m/s"},   {"vz", "m/s"}};
constexpr Component kForce[] = {{"tx", "N m"}, {"ty", "N m"}, {"tz", "N m"},
                                {"fx", "N"},   {"fy", "N"},   {"fz", "N"}};

struct HumanoidSettings : LocomotionSettings {
  // Settings of version 5 only.
  double contact_cost_weight = 0;
  Interval contact_cost_range;
  bool with_inertia = true;
  bool with_velocities = true;
  bool with_actuator_forces = true;
  bool with_contact_forces = true;
};

class Humanoid final : public Locomotion {
 public:
  using Settings = HumanoidSettings;
  static constexpr const char* kModelFile = "humanoid.xml";
  static constexpr ModelShape kShape = {
      .positions = 24, .velocities = 23, .motors = 17, .timestep = 0.003, .bodies = 14};
  static constexpr int kRootVelocityCount = 6;

  Humanoid(const EnvironmentSpec& spec, const HumanoidSettings& settings, MujocoScratch scratch)
      : Locomotion(spec, settings, InfoColumns(settings), std::move(scratch)), settings_(settings) {
    mjData* d = mutable_data();
    AddStatePart("com", centre_);
    AddStatePart("cinert", {d->cinert, size_t{10} * kShape.bodies});
    AddStatePart("cvel", {d->cvel, size_t{6} * kShape.bodies});
    AddStatePart("qfrc_actuator", {d->qfrc_actuator, size_t{kShape.velocities}});
    AddStatePart("cfrc_ext", {d->cfrc_ext, size_t{6} * kShape.bodies});
  }

  static HumanoidSettings ReadSettings(ConfigReader& reader);
  static EnvironmentSpec Describe(const HumanoidSettings& settings);
  static std::span<const InfoColumn> InfoColumns(const LocomotionSettings& settings);

  void Observe(std::span<double> observation) const override;

 protected:
  Point Position() const override { return centre_; }
  bool Healthy() const override { return settings().healthy_z.Contains(data().qpos[2]); }
  double ContactCost() const override;
  void StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                            std::span<double> qvel) const override;

  void AfterStep() override {
    mj_rnePostConstraint(&model(), mutable_data());  // fills cfrc_ext, as Gymnasium does
    FindCentre();
  }
  void AfterForward() override {
    Locomotion::AfterForward();
    FindCentre();
  }
  // A query has no step before it, so its reward starts from the exact centre of mass.
  void BeforeQuery() override {
    mj_kinematics(&model(), mutable_data());
    FindCentre();
  }

 private:
  void FindCentre();

  const HumanoidSettings& settings_;
  Point centre_{};  // centre of mass: x and y, m
};

void Humanoid::FindCentre() {
  double mass = 0, x = 0, y = 0;
  for (int i = 0; i < model().nbody; ++i) {
    mass += model().body_mass[i];
    x += model().body_mass[i] * data().xipos[3 * i];
    y += model().body_mass[i] * data().xipos[3 * i + 1];
  }
  centre_ = {x / mass, y / mass};
}

void Humanoid::Observe(std::span<double> observation) const {
  const HumanoidSettings& s = settings_;
  const mjData& d = data();
  double* out = observation.data();
  const auto append = [&out](const double* values, int skipped, int count) {
    out = std::copy(values + skipped, values + count, out);
  };
  const int skipped_bodies = s.v5 ? 1 : 0;
  append(d.qpos, s.with_positions ? 0 : 2, kShape.positions);
  append(d.qvel, 0, kShape.velocities);
  if (s.with_inertia) append(d.cinert, 10 * skipped_bodies, 10 * kShape.bodies);
  if (s.with_velocities) append(d.cvel, 6 * skipped_bodies, 6 * kShape.bodies);
  if (s.with_actuator_forces) {
    append(d.qfrc_actuator, s.v5 ? kRootVelocityCount : 0, kShape.velocities);
  }
  if (s.with_contact_forces) append(d.cfrc_ext, 6 * skipped_bodies, 6 * kShape.bodies);
}

double Humanoid::ContactCost() const {
  if (!settings_.v5) return 0;
  double squares = 0;
  for (int i = 0; i < 6 * kShape.bodies; ++i) squares += data().cfrc_ext[i] * data().cfrc_ext[i];
  const Interval& range = settings_.contact_cost_range;
  return std::clamp(settings_.contact_cost_weight * squares, range.low, range.high);
}

void Humanoid::StateFromObservation(std::span<const double> observation, std::span<double> qpos,
                                    std::span<double> qvel) const {
  const size_t skipped = settings().with_positions ? 0 : 2;
  const size_t positions = qpos.size() - skipped;
  std::ranges::copy(observation.first(positions), qpos.begin() + skipped);
  std::ranges::copy(observation.subspan(positions, qvel.size()), qvel.begin());
  mju_normalize4(qpos.data() + 3);  // a quaternion of zeros becomes the upright one
}

HumanoidSettings Humanoid::ReadSettings(ConfigReader& reader) {
  HumanoidSettings settings;
  settings.forward_reward_weight = 1.25;
  settings.ctrl_cost_weight = 0.1;
  settings.reset_noise_scale = 1e-2;
  settings.frame_skip = 5;
  settings.healthy_reward = 5;
  settings.healthy_z = {1.0, 2.0};
  ReadCommonSettings(reader, &settings);
  ReadHealthSettings(reader, &settings);
  if (!settings.v5) return settings;
  settings.contact_cost_weight = reader.Number("contact_cost_weight", 5e-7, -1e6, 1e6);
  settings.contact_cost_range = reader.Range("contact_cost_range", {-kInfinity, 10.0});
  settings.with_inertia = reader.Bool("include_cinert_in_observation", true);
  settings.with_velocities = reader.Bool("include_cvel_in_observation", true);
  settings.with_actuator_forces = reader.Bool("include_qfrc_actuator_in_observation", true);
  settings.with_contact_forces = reader.Bool("include_cfrc_ext_in_observation", true);
  return settings;
}

// Dimensions are named after what they belong to: "abdomen-z", "v-abdomen-z", "cinert-torso-ixx".
SpaceSpec ObservationSpace(const HumanoidSettings& settings) {
  SpaceSpec space;
  const auto add = [&space](const std::string& name, const char* unit) {
    space.dimensions.push_back({name, unit, -kInfinity, kInfinity});
  };
  const auto add_bodies = [&](const std::string& prefix, std::span<const Component> components) {
    for (const char* body : std::span(kBodies).subspan(settings.v5 ? 1 : 0)) {
      for (const auto& [name, unit] : components) add(prefix + "-" + body + "-" + name, unit);
    }
  };
  if (settings.with_positions) {
    add("root-x", "m");
    add("root-y", "m");
  }
  add("root-z", "m");
  for (const char* entry : {"w", "x", "y", "z"}) add(std::string("root-quaternion-") + entry, "");
  for (const char* joint : kJoints) add(joint, "rad");
  for (const auto& [name, unit] : kRootVelocities) add(name, unit);
  for (const char* joint : kJoints) add(std::string("v-") + joint, "rad/s");
  if (settings.with_inertia) add_bodies("cinert", kInertia);
  if (settings.with_velocities) add_bodies("cvel", kVelocity);
  if (settings.with_actuator_forces) {
    for (const char* entry : {"fx", "fy", "fz", "tx", "ty", "tz"}) {
      if (!settings.v5) add(std::string("qfrc-root-") + entry, entry[0] == 'f' ? "N" : "N m");
    }
    for (const char* joint : kJoints) add(std::string("qfrc-") + joint, "N m");
  }
  if (settings.with_contact_forces) add_bodies("cfrc", kForce);
  space.shape = {space.size()};
  return space;
}

EnvironmentSpec Humanoid::Describe(const HumanoidSettings& settings) {
  EnvironmentSpec spec;
  DescribeLocomotion(settings, InfoColumns(settings), &spec);
  spec.name = "Humanoid";
  spec.observation = ObservationSpace(settings);
  for (const char* motor : kMotors) spec.action.dimensions.push_back({motor, "", -0.4, 0.4});
  spec.action.shape = {spec.action.size()};
  spec.reward =
      "forward_reward_weight * (x_after - x_before) / dt + healthy_reward - "
      "ctrl_cost_weight * sum(action^2), x of the centre of mass";
  if (settings.v5) spec.reward += "; minus contact_cost_weight * sum(cfrc_ext^2), clipped";
  spec.step_seconds = kShape.timestep * settings.frame_skip;
  spec.termination.emplace();
  if (settings.terminate_when_unhealthy) {
    // MOPO's source, unlike Gymnasium, counts the ends of the range as healthy.
    const uint32_t height = settings.with_positions ? 2 : 0;
    spec.termination->push_back(
        {height, settings.healthy_z.low, settings.healthy_z.high, /*inclusive=*/true});
  }
  return spec;
}

std::span<const InfoColumn> Humanoid::InfoColumns(const LocomotionSettings& settings) {
  static constexpr InfoColumn kV4[] = {
      {"reward_linvel", Info::kForward}, {"reward_quadctrl", Info::kControl},
      {"reward_alive", Info::kSurvive},  {"x_position", Info::kX},
      {"y_position", Info::kY},          {"distance_from_origin", Info::kDistance},
      {"x_velocity", Info::kXVelocity},  {"y_velocity", Info::kYVelocity},
      {"forward_reward", Info::kForward}};
  static constexpr InfoColumn kV5[] = {{"x_position", Info::kRootX, true},
                                       {"y_position", Info::kRootY, true},
                                       {"tendon_length[0]", Info::kTendonLength0, true},
                                       {"tendon_length[1]", Info::kTendonLength1, true},
                                       {"tendon_velocity[0]", Info::kTendonVelocity0, true},
                                       {"tendon_velocity[1]", Info::kTendonVelocity1, true},
                                       {"distance_from_origin", Info::kRootDistance, true},
                                       {"x_velocity", Info::kXVelocity},
                                       {"y_velocity", Info::kYVelocity},
                                       {"reward_survive", Info::kSurvive},
                                       {"reward_forward", Info::kForward},
                                       {"reward_ctrl", Info::kControl},
                                       {"reward_contact", Info::kContact}};
  return settings.v5 ? std::span<const InfoColumn>(kV5) : std::span<const InfoColumn>(kV4);
}

using Model = MujocoTask<Humanoid>;

}  // namespace

extern const EnvironmentEntry kHumanoid;  // its line in list.cc
constinit const EnvironmentEntry kHumanoid = {"Humanoid", Model::Complete, Model::Describe,
                                              Model::Open};

}  // namespace b4mrl
