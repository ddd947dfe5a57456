"""Highway and highway-env side by side: the same seeds, settings and actions give the same numbers.

Needs highway-env 1.12.1, which `run --long` installs.
"""

from __future__ import annotations

from typing import Any

import b4mrl
import gymnasium
import numpy as np
import pytest

pytest.importorskip("highway_env")

CONTINUOUS = {"type": "ContinuousAction"}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "default": ("highway-fast-v0", {"vehicles_count": 3}),
    "simulator": ("highway-fast-v0", {"vehicles_count": 15}),
    "fast": ("highway-fast-v0", {}),
    "v0": ("highway-v0", {}),
    "dense": ("highway-v0", {"vehicles_count": 20, "vehicles_density": 2, "lanes_count": 2}),
    "quick-policy": ("highway-v0", {"vehicles_count": 15, "policy_frequency": 5, "duration": 8}),
    "see-behind": (
        "highway-v0",
        {
            "vehicles_count": 15,
            "observation": {
                "type": "Kinematics",
                "vehicles_count": 15,
                "see_behind": True,
                "normalize": False,
                "features": ["presence", "x", "y", "vx", "vy", "heading", "lat_off"],
            },
        },
    ),
    "rewards": (
        "highway-fast-v0",
        {
            "vehicles_count": 10,
            "normalize_reward": False,
            "offroad_terminal": True,
            "collision_reward": -2,
            "right_lane_reward": 0.3,
            "reward_speed_range": [10, 25],
        },
    ),
}

# A car that is slower than this may wobble about its course, by which it amplifies rounding without
# bound; from then on numbers are not compared. At 5 frames a second the bound is 3.6 m/s.
WOBBLING_SPEED = 4.0


def same_numbers(env: gymnasium.Env) -> bool:
    vehicles = env.road.vehicles
    return all(car is env.vehicle or abs(car.speed) > WOBBLING_SPEED for car in vehicles)


@pytest.mark.parametrize("name", CASES)
def test_highway_is_highway_env(client: b4mrl.Client, name: str, long: bool) -> None:
    task, settings = CASES[name]
    config = {"action": CONTINUOUS, **settings}
    original = gymnasium.make(task, config=config).unwrapped
    compared = 0
    with client.make("Highway", config={"env_id": task, **config}) as env:
        assert env.observation_space.shape == original.observation_space.shape
        for seed in range(10 if long else 1):
            rng = np.random.default_rng(seed)
            for reset in range(3):
                # The resets after the first one continue the seed's stream.
                wanted, _ = original.reset(seed=seed if reset == 0 else None)
                observation, _ = env.reset(seed=seed if reset == 0 else None)
                np.testing.assert_array_equal(observation, wanted)
                comparable, ended = True, False
                while not ended:
                    action = rng.uniform([-1, -0.03], [1, 0.03]).astype(np.float32)
                    observation, reward, *flags, info = env.step(action)
                    wanted, wanted_reward, *wanted_flags, wanted_info = original.step(action)
                    assert flags == wanted_flags
                    ended = any(flags)
                    comparable = comparable and same_numbers(original)
                    if not comparable:
                        continue
                    compared += 1
                    # Rounding to float32 may go either way.
                    np.testing.assert_allclose(observation, wanted, rtol=1e-6, atol=1e-6)
                    assert abs(reward - wanted_reward) <= 1e-9
                    assert abs(info["speed"] - wanted_info["speed"]) <= 1e-9
                    assert info["crashed"] == wanted_info["crashed"]
                    for key, value in wanted_info["rewards"].items():
                        assert abs(info["rewards"][key] - value) <= 1e-9
    assert compared > 20
