"""Agents' files made for tests, and what the programs say of one."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import h5py
import numpy as np
from b4mrl.serve import find_server

CARRIED = Path(__file__).parents[4] / "data" / "agents" / "halfcheetah-medium.h5"
SIZE, ACTIONS, HIDDEN = 3, 2, 5

RAGGED = [[1], [1, 2]]  # no array


def write_agent(path: Path, history: int = 1, **changes: object) -> dict:
    rng = np.random.default_rng(3)
    entries = {
        "nonlinearity": b"relu",
        "output_distribution": b"tanh",
        "history_length": history,
        "observation_mask": np.array([1, 0, 1]),
        "observation_mean": rng.normal(size=SIZE),
        "observation_std": rng.uniform(0.5, 2, size=SIZE),
        "action_scale": np.array([0.4, 2.0]),
        "fc0/weight": rng.normal(size=(HIDDEN, SIZE * history)),
        "fc0/bias": rng.normal(size=HIDDEN),
        "last_fc/weight": rng.normal(size=(ACTIONS, HIDDEN)),
        "last_fc/bias": rng.normal(size=ACTIONS),
    } | changes
    with h5py.File(path, "w") as file:
        file["metadata/environment"] = b"HalfCheetah"
        for name, value in entries.items():
            if value is not None:
                file[f"metadata/policy/{name}"] = value
    return entries


def formula(entries: dict, observations: list[np.ndarray], activation: str = "relu") -> np.ndarray:
    """The action for a history of observations, oldest first, in float64."""
    layers = sum(name.startswith("fc") and name.endswith("weight") for name in entries)
    rows = []
    for observation in observations:
        row = (observation - entries["observation_mean"]) / entries["observation_std"]
        rows.append(row * entries["observation_mask"])
    hidden = np.concatenate(rows)
    for layer in range(layers):
        hidden = entries[f"fc{layer}/weight"] @ hidden + entries[f"fc{layer}/bias"]
        hidden = np.maximum(hidden, 0) if activation == "relu" else np.tanh(hidden)
    output = entries["last_fc/weight"] @ hidden + entries["last_fc/bias"]
    return entries["action_scale"] * np.tanh(output)


# Float32 against float64 over a dozen operations on numbers near 1.
TOLERANCE = 1e-5


def evaluate(agent: Path) -> subprocess.CompletedProcess[str]:
    """`b4mrl evaluate --json` of one episode."""
    command = [Path(find_server()[0]).with_name("b4mrl-tools"), "evaluate", "--json"]
    command += ["--environment", "HalfCheetah", "--episodes", "1", "--agent", agent]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def run_evaluate(agent: Path) -> dict:
    """What `b4mrl evaluate --json` prints for one episode."""
    done = evaluate(agent)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def random_layers(sizes: list[int]) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    return [
        (rng.normal(size=(outputs, inputs)) / inputs**0.5, rng.normal(size=outputs))
        for inputs, outputs in zip(sizes, sizes[1:])
    ]
