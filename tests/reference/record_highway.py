#!/usr/bin/env python3
"""Records trajectories of highway-env's own tasks for convert_highway.py.

  record_highway.py OUT        (needs highway-env 1.12.1 and NumPy 2)

Each case is a configuration, a start and a rule for the actions; together they cover the settings that the
recordings of the defaults leave out. One JSON file a case, in the layout that README.md describes.
"""
import json
import math
import pathlib
import sys

import gymnasium
import highway_env  # noqa: F401  registers the tasks
import numpy as np

CONTINUOUS = {"type": "ContinuousAction"}
COLUMNS = ["x", "y", "heading", "speed", "lane", "target_lane", "timer", "crashed", "impact_pending", "impact_x",
           "impact_y", "steering", "acceleration"]


def weave(env, t, rng):
    return np.array([rng.uniform(-0.3, 0.6), 0.08 * math.sin(t)])


def keep_lane(env, t, rng):
    ego = env.vehicle
    offset = ego.position[1] - 4 * ego.lane_index[2]
    return np.array([rng.uniform(-1, 1), np.clip(-0.01 * offset - 0.3 * ego.heading, -1, 1)])


def wild(env, t, rng):
    return rng.uniform(-1.5, 1.5, 2)


def leave_road(env, t, rng):
    return np.array([0.2, -0.06 if t < 2 else 0.03])


# name: (task, configuration, driver, steps, resets after the seeded one, scrambled start)
CASES = {
    "third-reset": ("highway-fast-v0", {"vehicles_count": 4}, keep_lane, 6, 3, False),
    "one-lane": ("highway-v0", {"vehicles_count": 5, "lanes_count": 1}, keep_lane, 6, 1, False),
    "features": ("highway-v0", {"vehicles_count": 6, "observation": {
        "type": "Kinematics", "vehicles_count": 6, "see_behind": True, "order": "unsorted",
        "features": ["presence", "heading", "cos_h", "sin_h", "cos_d", "sin_d", "long_off", "lat_off", "ang_off",
                     "x", "vy"]}}, keep_lane, 6, 0, True),
    "absolute": ("highway-v0", {"vehicles_count": 6, "observation": {
        "type": "Kinematics", "vehicles_count": 9, "absolute": True, "clip": False,
        "features_range": {"x": [-100, 100], "heading": [-1, 1]},
        "features": ["presence", "x", "y", "heading", "vx"]}}, weave, 6, 0, False),
    "bounds": ("highway-v0", {"vehicles_count": 5, "action": {
        "type": "ContinuousAction", "acceleration_range": [-8, 4], "steering_range": [-0.2, 0.3],
        "speed_range": [5, 28]}}, wild, 8, 0, False),
    "unclipped": ("highway-v0", {"vehicles_count": 5, "action": {
        "type": "ContinuousAction", "clip": False}}, wild, 6, 0, True),
    "throttle-only": ("highway-v0", {"vehicles_count": 5, "initial_lane_id": 2, "action": {
        "type": "ContinuousAction", "lateral": False}}, wild, 8, 2, False),
    "rewards": ("highway-fast-v0", {
        "vehicles_count": 5, "normalize_reward": False, "offroad_terminal": True, "collision_reward": -2,
        "right_lane_reward": 0.3, "high_speed_reward": 0.7, "reward_speed_range": [10, 25],
        "on_road_reward": 0.25}, leave_road, 8, 0, False),
    "no-frames": ("highway-fast-v0", {"vehicles_count": 3, "policy_frequency": 10, "duration": 0.5}, weave, 7, 0,
                  False),
    "float32": ("highway-v0", {"vehicles_count": 5, "vehicles_density": 2}, keep_lane, 6, 0, True),
}


def vehicle_row(env, vehicle):
    ego = vehicle is env.vehicle
    impact = vehicle.impact if vehicle.impact is not None else (0, 0)
    return [float(value) for value in (
        vehicle.position[0], vehicle.position[1], vehicle.heading, vehicle.speed, vehicle.lane_index[2],
        -1 if ego else vehicle.target_lane_index[2], 0 if ego else vehicle.timer, vehicle.crashed,
        vehicle.impact is not None, impact[0], impact[1], vehicle.action["steering"], vehicle.action["acceleration"])]


def scramble(env, rng):
    """A start that no reset gives: overlaps, odd angles, changes of lane under way."""
    lanes = env.config["lanes_count"]
    x = 300.0
    for vehicle in env.road.vehicles:
        x += rng.uniform(0, 14)
        vehicle.position = np.array([x, rng.uniform(-1, 4 * lanes - 3)])
        vehicle.heading = rng.uniform(-0.3, 0.3)
        vehicle.speed = rng.uniform(5, 35)
        vehicle.on_state_update()
        if vehicle is env.vehicle:
            continue
        vehicle.target_lane_index = ("0", "1", int(rng.integers(lanes)))
        vehicle.target_speed = rng.uniform(15, 34)
        vehicle.timer = rng.uniform(0, 1.5)


def record(name, seed):
    task, config, driver, steps, resets, scrambled = CASES[name]
    config = {"action": CONTINUOUS, **config}
    rng = np.random.default_rng(seed)
    env = gymnasium.make(task, config=config).unwrapped
    observation, _ = env.reset(seed=seed)
    for _ in range(resets):
        observation, _ = env.reset()
    if scrambled:
        scramble(env, rng)
        observation = env.observation_type.observe()
    cars = env.road.vehicles
    single = name == "float32"
    result = {
        "name": name, "env_id": task, "seed": seed, "episode": resets, "scrambled": scrambled, "config": config,
        "actions_are_float32": single, "state_columns": COLUMNS,
        "delta": [float(getattr(car, "DELTA", 0)) if car is not env.vehicle else 0.0 for car in cars],
        "target_speed": [float(car.target_speed) if car is not env.vehicle else 0.0 for car in cars],
        "initial_state": [vehicle_row(env, car) for car in cars], "initial_obs": observation.tolist(),
        "strict_steps": steps, "actions": [], "states": [], "obs": [], "reward": [], "terminated": [],
        "truncated": [], "on_road": []}
    for t in range(steps):
        action = driver(env, t, rng)[: env.action_space.shape[0]]
        if single:
            action = action.astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        result["actions"].append(action.tolist())
        result["states"].append([vehicle_row(env, car) for car in cars])
        result["obs"].append(observation.tolist())
        result["reward"].append(float(reward))
        result["terminated"].append(bool(terminated))
        result["truncated"].append(bool(truncated))
        result["on_road"].append(bool(env.vehicle.on_road))
    return result


def main():
    out = pathlib.Path(sys.argv[1])
    out.mkdir(parents=True, exist_ok=True)
    for seed, name in enumerate(CASES, start=11):
        (out / f"{name}.json").write_text(json.dumps(record(name, seed)))


if __name__ == "__main__":
    main()
