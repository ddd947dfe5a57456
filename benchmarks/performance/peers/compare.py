"""Gradient steps a second of b4mrl and of its peers, measured in turns on one thread each.

Rates are of processor time, every turn measures all of them one after the other, and the medians of
the turns are compared, so that what else runs on the machine weighs little. All see HalfCheetah's sizes and a batch of 256 that is already in
memory: Stable-Baselines3's replay buffer hands out one batch that was drawn before.
"""

import argparse
import collections
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

PEERS: dict[str, Callable[[], Callable[[], None]]] = {
    "Stable-Baselines3 SAC": stable_baselines.sac,
    "Stable-Baselines3 TD3": stable_baselines.td3,
    "plain PyTorch IQL": iql_pytorch.iql,
    "plain PyTorch ensemble": ensemble_pytorch.ensemble,
}

# Name in `b4mrl perf update`, the peer that it is compared with, and the ratio to reach. The names
# in bf16 are measured on processors with AVX512-BF16 alone; peers compute in fp32.
COMPARISONS = [
    ("update-sac", "Stable-Baselines3 SAC", 1.9),
    ("update-td3", "Stable-Baselines3 TD3", 1.6),
    ("update-iql", "plain PyTorch IQL", 1.3),
    ("update-ensemble", "plain PyTorch ensemble", 1.3),
    ("update-sac-bf16", "Stable-Baselines3 SAC", 3.0),
    ("update-td3-bf16", "Stable-Baselines3 TD3", 2.8),
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

    updates = {peer: make() for peer, make in PEERS.items()}
    for update in updates.values():
        rate(update, 0.2)  # warms up
    own: dict[str, list[float]] = collections.defaultdict(list)
    theirs: dict[str, list[float]] = collections.defaultdict(list)
    for _ in range(arguments.turns):
        for name, value in own_rates(arguments.perf, arguments.seconds).items():
            own[name].append(value)
        for peer, update in updates.items():
            theirs[peer].append(rate(update, arguments.seconds))

    print(
        f"Python {platform.python_version()}, PyTorch {torch.__version__}, "
        f"Stable-Baselines3 {stable_baselines3.__version__}; "
        f"medians of {arguments.turns} turns, one thread"
    )
    print(f"{'measure':<16} {'b4mrl':>9} {'peer':>9}  ratio   goal  peer is")
    for name, peer, goal in COMPARISONS:
        if name not in own:
            continue
        ours, other = statistics.median(own[name]), statistics.median(theirs[peer])
        print(f"{name:<16} {ours:>7.1f}/s {other:>7.1f}/s {ours / other:>6.2f} {goal:>6.1f}  {peer}")


if __name__ == "__main__":
    main()
