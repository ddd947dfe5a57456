"""Writes the transitions of training runs as one dataset in D4RL's layout.

    python join_replays.py OUT.h5 PART...        (needs numpy and h5py)

A PART is the folder of an online `b4mrl train` of HalfCheetah, whose whole episodes of 1,000 steps
up to its newest checkpoint are taken, or a dataset in D4RL's layout, which is taken whole. A part
whose rows are not such episodes is refused, and no file written. Prints the number of episodes,
their mean return and the best. `b4mrl dataset import OUT.h5 --name HalfCheetah/NAME` makes it a
dataset to train on.
"""

import argparse
import json
import sys
from pathlib import Path

import h5py
import numpy as np
from write_replay import read_replay, stored_transitions

STEPS = 1_000  # of an episode of HalfCheetah, which always ends by its time limit
COLUMNS = ("observations", "actions", "next_observations", "rewards", "terminals", "timeouts")


def check_episodes(path: Path, part: dict[str, np.ndarray]) -> None:
    """Ends the program unless the rows are whole episodes, in their order."""
    rows = len(part["rewards"])
    ends = np.arange(rows) % STEPS == STEPS - 1
    inside = np.flatnonzero(~ends[:-1])
    joined = np.array_equal(part["next_observations"][inside], part["observations"][inside + 1])
    timed_out = np.array_equal(part["timeouts"].astype(bool).ravel(), ends)
    if rows == 0 or rows % STEPS or part["terminals"].any() or not timed_out or not joined:
        sys.exit(f"{path} does not hold whole episodes of {STEPS} steps")


def of_dataset(path: Path) -> dict[str, np.ndarray]:
    with h5py.File(path) as file:
        part = {name: file[name][()] for name in COLUMNS}
    check_episodes(path, part)
    return part


def of_run(run: Path) -> dict[str, np.ndarray]:
    lanes = int(json.loads((run / "run.json").read_text())["hyperparameters"]["lanes"])
    rows = stored_transitions(run, lanes) // STEPS * STEPS
    _, part = read_replay(run, rows)
    part["timeouts"] = np.arange(rows) % STEPS == STEPS - 1
    check_episodes(run, part)
    return part


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="file to write")
    parser.add_argument("part", type=Path, nargs="+", help="folder of a run, or a dataset")
    arguments = parser.parse_args()
    parts = [of_run(path) if path.is_dir() else of_dataset(path) for path in arguments.part]
    table = {name: np.concatenate([part[name] for part in parts]) for name in COLUMNS}
    with h5py.File(arguments.out, "w") as file:
        for name, column in table.items():
            file.create_dataset(name, data=column)
    returns = table["rewards"].reshape(-1, STEPS).sum(axis=1)
    print(f"{returns.size} episodes, mean return {returns.mean():.1f}, best {returns.max():.1f}")


if __name__ == "__main__":
    main()
