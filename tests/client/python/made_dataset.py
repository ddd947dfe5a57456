"""Datasets for tests: what `b4mrl dataset make` wrote, and an example whose numbers a test knows."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import b4mrl
import h5py
import numpy as np
from b4mrl.serve import find_server

NAME = "Hopper/random"  # episodes of some 20 rows, which end by the task's rule
ROWS = 3_000  # the last episode is cut off

EXAMPLE_ROWS, EXAMPLE_EPISODE = 5_000, 100


def run_dataset(data: Path, *words: str | Path) -> None:
    tools = Path(find_server()[0]).with_name("b4mrl-tools")
    command = [tools, "dataset", *words, "--data", data, "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def make_dataset(data: Path) -> Path:
    """Makes NAME in the data folder `data`, and returns its file."""
    run_dataset(data, "make", NAME, "--rows", str(ROWS))
    return data / "Hopper" / "random-v0.h5"


def rows_recorded_by(agent: Path, data: Path) -> dict[str, np.ndarray]:
    """10,000 rows of HalfCheetah, recorded by the programs with the deterministic agent of a file.

    A dataset is recorded by stochastic policies alone, so the file's policy becomes one whose noise
    is exp(-20) of a normal.
    """
    with h5py.File(agent, "a") as file:
        policy = file["metadata/policy"]
        actions, width = policy["last_fc/weight"].shape
        policy["last_fc_log_std/weight"] = np.zeros((actions, width), np.float32)
        policy["last_fc_log_std/bias"] = np.full(actions, -20, np.float32)
        del policy["output_distribution"]
        policy["output_distribution"] = "tanh_gaussian"
    run_dataset(data, "make", "HalfCheetah/mine", "--agent", agent, "--rows", "10000")
    with b4mrl.serve(data=data) as endpoint, b4mrl.connect(endpoint) as client:
        return client.dataset("HalfCheetah/mine").load()


def write_example(
    path: Path, change: Callable[[dict[str, np.ndarray]], None] = lambda columns: None
) -> dict[str, np.ndarray]:
    """Recognisable numbers near those that HalfCheetah has: episodes that end by time-out."""
    rng = np.random.default_rng(7)
    columns = {
        "observations": rng.normal(scale=0.1, size=(EXAMPLE_ROWS, 17)).astype(np.float32),
        "actions": rng.uniform(-1, 1, size=(EXAMPLE_ROWS, 6)).astype(np.float32),
        "rewards": np.arange(EXAMPLE_ROWS, dtype=np.float32),
        "next_observations": rng.normal(scale=0.1, size=(EXAMPLE_ROWS, 17)).astype(np.float32),
        "terminals": np.zeros(EXAMPLE_ROWS, bool),
        "timeouts": np.arange(EXAMPLE_ROWS) % EXAMPLE_EPISODE == EXAMPLE_EPISODE - 1,
    }
    change(columns)
    path.parent.mkdir(parents=True, exist_ok=True)
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        for name, column in columns.items():
            file[name] = column
    return columns
