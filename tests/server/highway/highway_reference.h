// The recorded trajectories of highway-env (tests/reference/highway.*; README.md has the layout).
#pragma once

#include <catch2/catch.hpp>
#include <fstream>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "server/highway/traffic.h"
#include "tests/reference/npy.h"

namespace b4mrl {

// Columns of a recorded state: those of kVehicleColumns without the two constants of a driver.
inline constexpr size_t kRecordedColumns = 13;

struct HighwayStep {
  std::span<const double> action, states, observation;
  double reward;
  bool terminated, truncated, on_road;
};

// One trajectory; views into the file's numbers, which live as long as the program.
struct HighwayTrajectory {
  std::string name;
  std::string config;  // JSON
  uint64_t seed;
  uint64_t episode;
  bool scrambled;  // a start that no reset gives
  bool float32;    // actions are of that type
  size_t strict_steps;
  size_t vehicles;
  std::span<const double> initial_vehicles, initial_observation;
  std::vector<HighwayStep> steps;
  std::vector<std::span<const double>> frames;  // states after each frame of the first steps
};

inline std::vector<HighwayTrajectory> ReadHighwayTrajectories() {
  const std::string path = B4MRL_SOURCE_DIR "/tests/reference/highway";
  static const NpyArray numbers = ReadNpy(path + ".npy");
  std::ifstream file(path + ".json");
  std::vector<HighwayTrajectory> trajectories;
  for (const nlohmann::json& entry : nlohmann::json::parse(file)) {
    size_t at = entry["offset"];
    const auto take = [&at](size_t count) {
      at += count;
      return std::span(numbers.values).subspan(at - count, count);
    };
    HighwayTrajectory t{.name = entry["name"],
                        .config = entry["config"].dump(),
                        .seed = entry["seed"],
                        .episode = entry["episode"],
                        .scrambled = entry["scrambled"],
                        .float32 = entry["float32"],
                        .strict_steps = entry["strict_steps"],
                        .vehicles = entry["vehicles"],
                        .initial_vehicles = {},
                        .initial_observation = {},
                        .steps = {},
                        .frames = {}};
    const size_t observation_size = entry["observation_size"];
    t.initial_vehicles = take(t.vehicles * kVehicleColumns);
    t.initial_observation = take(observation_size);
    for (size_t i = 0; i < entry["steps"]; ++i) {
      HighwayStep step{.action = take(entry["action_size"]),
                       .states = take(t.vehicles * kRecordedColumns),
                       .observation = take(observation_size)};
      const auto outcome = take(4);
      step.reward = outcome[0];
      step.terminated = outcome[1] != 0;
      step.truncated = outcome[2] != 0;
      step.on_road = outcome[3] != 0;
      t.steps.push_back(step);
    }
    const size_t frames = entry["frame_steps"].get<size_t>() * entry["frames"].get<size_t>();
    for (size_t i = 0; i < frames; ++i) t.frames.push_back(take(t.vehicles * kRecordedColumns));
    trajectories.push_back(std::move(t));
  }
  REQUIRE(trajectories.size() > 20);
  return trajectories;
}

}  // namespace b4mrl
