"""Gradient steps a second of b4mrl and of its peers, measured in turns on one thread each.

Rates are of processor time, every turn measures all of them one after the other, and the medians of
the turns are compared, so that what else runs on the machine weighs little. All see HalfCheetah's sizes and a batch of 256 that is already in
memory: Stable-Baselines3's replay buffer hands out one batch that was drawn before.
"""

import argparse
import json
import pathlib
import platform
import statistics
import subprocess
import time
from collections.abc import Callable

import stable_baselines3
import torch

import ensemble_pytorch
import iql_pytorch
import stable_baselines

ROOT = pathlib.Path(__file__).resolve().parents[3]

# Name in `b4mrl perf update`, the peer that it is compared with, and the ratio to reach.
PEERS: list[tuple[str, str, Callable[[], Callable[[], None]], float]] = [
    ("update-sac", "Stable-Baselines3 SAC", stable_baselines.sac, 1.9),
    ("update-td3", "Stable-Baselines3 TD3", stable_baselines.td3, 1.6),
    ("update-iql", "plain PyTorch IQL", iql_pytorch.iql, 1.3),
    ("update-ensemble", "plain PyTorch ensemble", ensemble_pytorch.ensemble, 1.3),
]


def rate(update: Callable[[], None], seconds: float) -> float:
    """Calls per second of processor time, measured over about `seconds` of processor time."""
    calls = 0
    start = time.process_time()
    while (elapsed := time.process_time() - start) < seconds:
        update()
        calls += 1
    return calls / elapsed


def own_rates(perf: pathlib.Path, seconds: float) -> dict[str, float]:
    """One turn of `b4mrl perf update`, by name."""
    command = [perf, "update", "--json", "--turns", "1", "--seconds", str(seconds)]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    return {entry["name"]: entry["value"] for entry in map(json.loads, lines)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=7, help="number of measurements of each learner")
    parser.add_argument("--seconds", type=float, default=1.0, help="processor seconds of a measurement")
    parser.add_argument("--perf", type=pathlib.Path, default=ROOT / "build/release/b4mrl-perf")
    arguments = parser.parse_args()
    torch.set_num_threads(1)

    updates = {name: make() for name, _, make, _ in PEERS}
    for update in updates.values():
        rate(update, 0.2)  # warms up
    own: dict[str, list[float]] = {name: [] for name in updates}
    theirs: dict[str, list[float]] = {name: [] for name in updates}
    for _ in range(arguments.turns):
        for name, value in own_rates(arguments.perf, arguments.seconds).items():
            if name in own:
                own[name].append(value)
        for name, update in updates.items():
            theirs[name].append(rate(update, arguments.seconds))

    print(
        f"Python {platform.python_version()}, PyTorch {torch.__version__}, "
        f"Stable-Baselines3 {stable_baselines3.__version__}; "
        f"medians of {arguments.turns} turns, one thread"
    )
    print(f"{'measure':<16} {'b4mrl':>9} {'peer':>9}  ratio   goal  peer is")
    for name, peer, _, goal in PEERS:
        ours, other = statistics.median(own[name]), statistics.median(theirs[name])
        print(f"{name:<16} {ours:>7.1f}/s {other:>7.1f}/s {ours / other:>6.2f} {goal:>6.1f}  {peer}")


if __name__ == "__main__":
    main()
