// Records a task, perturbed or not, from the original's model file and with nothing of this
// project: MuJoCo's C interface and the formulas of the Gymnasium task alone.
//
//   g++ -O2 -std=c++20 -ffp-contract=off record_mujoco.cc -o record_mujoco -lmujoco
//   record_mujoco TASK ORIGINAL.xml GRAVITY FRICTION START STEPS OUT.npy
//
// TASK is a line of kTasks below; a new task gets its own. ORIGINAL.xml is its file in
// gymnasium/envs/mujoco/assets; GRAVITY and FRICTION are factors. START is a recording, whose
// starts and first STEPS actions are taken (0: all), or a whole number, from which two starts near
// the model's own and random actions are drawn. OUT.npy has the layout that README.md describes.
// With factors 1 and all steps of a recording of the same model, OUT.npy is that recording byte for
// byte, which shows that this program records what the originals' recordings hold.
#include <mujoco/mujoco.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>
#include <string>
#include <vector>

namespace {

struct Table {
  size_t trajectories, rows, columns;
  std::vector<double> values;
  double* Row(size_t i, size_t k) { return &values[(i * rows + k) * columns]; }
};

Table Read(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string bytes(std::istreambuf_iterator<char>(file), {});
  uint16_t header = 0;
  std::memcpy(&header, bytes.data() + 8, sizeof(header));
  Table table;
  std::sscanf(std::strchr(bytes.data() + 10, '('), "(%zu, %zu, %zu)", &table.trajectories,
              &table.rows, &table.columns);
  table.values.resize(table.trajectories * table.rows * table.columns);
  std::memcpy(table.values.data(), bytes.data() + 10 + header, 8 * table.values.size());
  return table;
}

// In NumPy's own words: padded so that the numbers start at a multiple of 64.
void Write(const Table& table, const std::string& path) {
  char text[128];
  std::snprintf(text, sizeof(text),
                "{'descr': '<f8', 'fortran_order': False, 'shape': (%zu, %zu, %zu), }",
                table.trajectories, table.rows, table.columns);
  std::string header = text;
  header.resize(117, ' ');
  header += '\n';
  std::ofstream file(path, std::ios::binary);
  file.write("\x93NUMPY\x01\x00\x76\x00", 10);
  file.write(header.data(), 118);
  file.write(reinterpret_cast<const char*>(table.values.data()), 8 * table.values.size());
}

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Task {
  const char* name;
  int frame_skip;
  double forward_weight, control_weight, healthy_reward;
  double contact_weight;  // of version 5's reward
  int hidden_positions;   // leading coordinates that are not observed
  double velocity_limit;  // of what is observed
  bool body_observed;     // the rows of every body and actuator, behind positions and velocities
  double (*progress)(const mjModel*, const mjData*);
  bool (*healthy)(const mjModel*, const mjData*);
};

double RootX(const mjModel*, const mjData* d) { return d->qpos[0]; }

double CentreOfMassX(const mjModel* m, const mjData* d) {
  double mass = 0, x = 0;
  for (int i = 0; i < m->nbody; ++i) {
    mass += m->body_mass[i];
    x += m->body_mass[i] * d->xipos[3 * i];
  }
  return x / mass;
}

bool Always(const mjModel*, const mjData*) { return true; }

bool HopperStands(const mjModel* m, const mjData* d) {
  bool bounded = true;
  for (int i = 2; i < m->nq; ++i) bounded = bounded && std::abs(d->qpos[i]) < 100;
  for (int i = 0; i < m->nv; ++i) bounded = bounded && std::abs(d->qvel[i]) < 100;
  return bounded && d->qpos[1] > 0.7 && std::abs(d->qpos[2]) < 0.2;
}

bool WalkerStands(const mjModel*, const mjData* d) {
  return d->qpos[1] > 0.8 && d->qpos[1] < 2.0 && std::abs(d->qpos[2]) < 1;
}

bool HumanoidStands(const mjModel*, const mjData* d) {
  return d->qpos[2] > 1.0 && d->qpos[2] < 2.0;
}

constexpr Task kTasks[] = {
    {"half_cheetah", 5, 1, 0.1, 0, 0, 1, kInfinity, false, RootX, Always},
    {"hopper", 4, 1, 1e-3, 1, 0, 1, 10, false, RootX, HopperStands},
    {"walker2d", 4, 1, 1e-3, 1, 0, 1, 10, false, RootX, WalkerStands},
    {"humanoid", 5, 1.25, 0.1, 5, 5e-7, 2, kInfinity, true, CentreOfMassX, HumanoidStands},
};

std::vector<double> Observe(const Task& task, const mjModel* m, const mjData* d) {
  std::vector<double> observation(d->qpos + task.hidden_positions, d->qpos + m->nq);
  for (int i = 0; i < m->nv; ++i) {
    observation.push_back(std::clamp(d->qvel[i], -task.velocity_limit, task.velocity_limit));
  }
  if (!task.body_observed) return observation;
  observation.insert(observation.end(), d->cinert, d->cinert + 10 * m->nbody);
  observation.insert(observation.end(), d->cvel, d->cvel + 6 * m->nbody);
  observation.insert(observation.end(), d->qfrc_actuator, d->qfrc_actuator + m->nv);
  observation.insert(observation.end(), d->cfrc_ext, d->cfrc_ext + 6 * m->nbody);
  return observation;
}

// reward, reward_v5, terminated
void Judge(const Task& task, const mjModel* m, const mjData* d, double before, double* out) {
  const double dt = m->opt.timestep * task.frame_skip;
  const double forward = task.forward_weight * ((task.progress(m, d) - before) / dt);
  double squares = 0, contact_squares = 0;
  for (int i = 0; i < m->nu; ++i) squares += d->ctrl[i] * d->ctrl[i];
  for (int i = 0; i < 6 * m->nbody; ++i) contact_squares += d->cfrc_ext[i] * d->cfrc_ext[i];
  const double control = task.control_weight * squares;
  const double contact = std::min(task.contact_weight * contact_squares, 10.0);
  const bool healthy = task.healthy(m, d);
  out[0] = forward + task.healthy_reward - control;
  out[1] = forward + (healthy ? task.healthy_reward : 0) - control - contact;
  out[2] = healthy ? 0 : 1;
}

// Uniform in -size..size; SplitMix64, so that a seed means the same everywhere.
double Draw(uint64_t* state, double size) {
  uint64_t z = *state += 0x9e3779b97f4a7c15;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9;
  z = (z ^ (z >> 27)) * 0x94d049bb133111eb;
  z ^= z >> 31;
  return size * (2 * (static_cast<double>(z >> 11) * 0x1p-53) - 1);
}

// A recording without anything but starts and actions.
Table DrawStarts(const mjModel* m, size_t observation_size, size_t steps, uint64_t seed) {
  constexpr double kNoise = 0.05;
  Table table = {2, steps + 1, m->nu + m->nq + 2 * m->nv + observation_size + 3, {}};
  table.values.resize(table.trajectories * table.rows * table.columns);
  for (size_t i = 0; i < table.trajectories; ++i) {
    double* start = table.Row(i, 0) + m->nu;
    for (int j = 0; j < m->nq; ++j) start[j] = m->qpos0[j] + Draw(&seed, kNoise);
    for (int j = 0; j < m->nv; ++j) start[m->nq + j] = Draw(&seed, kNoise);
    for (size_t k = 1; k < table.rows; ++k) {
      for (int j = 0; j < m->nu; ++j) {
        const mjtNum* range = m->actuator_ctrlrange + 2 * j;
        const double middle = (range[0] + range[1]) / 2;
        table.Row(i, k)[j] = static_cast<float>(middle + Draw(&seed, range[1] - middle));
      }
    }
  }
  return table;
}

void Record(const Task& task, const mjModel* m, mjData* d, Table& like, size_t i, Table& out) {
  const size_t start = m->nu, warm = m->nu + m->nq + m->nv, observed = warm + m->nv;
  for (size_t k = 0; k < out.rows; ++k) {
    double* row = out.Row(i, k);
    std::copy_n(like.Row(i, k), start, row);
    if (k == 0) {
      mj_resetData(m, d);
      std::copy_n(like.Row(i, 0) + start, m->nq, d->qpos);
      std::copy_n(like.Row(i, 0) + start + m->nq, m->nv, d->qvel);
      std::copy_n(like.Row(i, 0) + start, m->nq + m->nv, row + start);
      mj_forward(m, d);
    } else {
      const double before = task.progress(m, d);
      std::copy_n(row, m->nu, d->ctrl);
      for (int step = 0; step < task.frame_skip; ++step) mj_step(m, d);
      mj_rnePostConstraint(m, d);
      std::copy_n(d->qpos, m->nq, row + start);
      std::copy_n(d->qvel, m->nv, row + start + m->nq);
      Judge(task, m, d, before, row + out.columns - 3);
    }
    std::copy_n(d->qacc_warmstart, m->nv, row + warm);
    const std::vector<double> observation = Observe(task, m, d);
    std::copy(observation.begin(), observation.end(), row + observed);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 8) return 2;
  const std::string name = argv[1], start = argv[5];
  const auto task = std::find_if(std::begin(kTasks), std::end(kTasks),
                                 [&](const Task& entry) { return name == entry.name; });
  if (task == std::end(kTasks)) {
    std::fprintf(stderr, "no formulas for %s in kTasks\n", argv[1]);
    return 2;
  }
  char error[1000] = "";
  mjModel* m = mj_loadXML(argv[2], nullptr, error, sizeof(error));
  if (m == nullptr) {
    std::fprintf(stderr, "%s: %s\n", argv[2], error);
    return 3;
  }
  for (double& component : m->opt.gravity) component *= std::atof(argv[3]);
  for (int i = 0; i < 3 * m->ngeom; ++i) m->geom_friction[i] *= std::atof(argv[4]);
  mjData* d = mj_makeData(m);
  size_t steps = std::strtoul(argv[6], nullptr, 10);
  Table like = start.ends_with(".npy") ? Read(start)
                                       : DrawStarts(m, Observe(*task, m, d).size(), steps,
                                                    std::strtoull(start.c_str(), nullptr, 10));
  if (steps == 0) steps = like.rows - 1;
  Table out = {like.trajectories, steps + 1, like.columns, {}};
  out.values.resize(out.trajectories * out.rows * out.columns);
  for (size_t i = 0; i < out.trajectories; ++i) Record(*task, m, d, like, i, out);
  Write(out, argv[7]);
  mj_deleteData(d);
  mj_deleteModel(m);
}
