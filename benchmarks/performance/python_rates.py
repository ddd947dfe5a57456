"""Steps a second from Python, of b4mrl and of its peers: the measuring side of `b4mrl perf python`.

    python3 python_rates.py ENDPOINT  # its stdin is a socket

The first line sent is "ready" and the names of the loops that this Python can measure, or "failed"
and the reason. Each line received, "NAME SECONDS", is answered with the environment steps a second
of that loop, or with "failed" and the reason.

All loops step HalfCheetah or Humanoid with random float32 actions, drawn before, and reset what has
ended. Peers run in this process: Gymnasium without its environment checker, and EnvPool with its
default number of threads.
"""

from __future__ import annotations

import importlib.util
import itertools
import socket
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

BOUNDS = {"HalfCheetah": (6, 1.0), "Humanoid": (17, 0.4)}  # actions' size and largest value
CALLS = 16  # between two looks at the clock

Step = Callable[[], int]  # makes one call and returns the environment steps that it took


def drawn(environment: str, *shape: int) -> Iterator[Any]:
    """Random actions, the same ones over and over."""
    import numpy as np

    size, bound = BOUNDS[environment]
    rng = np.random.default_rng(0)
    return itertools.cycle(rng.uniform(-bound, bound, (256, *shape, size)).astype(np.float32))


def single(env: Any, environment: str) -> Step:
    actions = drawn(environment)
    env.reset(seed=0)

    def step() -> int:
        _, _, terminated, truncated, _ = env.step(next(actions))
        if terminated or truncated:
            env.reset()
        return 1

    return step


def batch(vec: Any, count: int) -> Step:
    actions = drawn("HalfCheetah", count)
    vec.reset()

    def step() -> int:
        vec.step(next(actions))
        return count

    return step


def halves(vec: Any, count: int) -> Step:
    """Each half of `vec`, whose first steps are under way, gets its next actions when it is done."""
    actions = drawn("HalfCheetah", count // 2)

    def step() -> int:
        *_, info = vec.recv()
        vec.send(next(actions), info["env_id"])
        return count // 2

    return step


def own_halves(vec: Any, count: int) -> Step:
    actions = drawn("HalfCheetah", count // 2)
    vec.reset()
    vec.send(next(actions), range(count // 2))
    vec.send(next(actions), range(count // 2, count))
    return halves(vec, count)


def own_loops(endpoint: str) -> dict[str, Callable[[], Step]]:
    import b4mrl

    client = b4mrl.connect(endpoint)
    return {
        "b4mrl-single": lambda: single(client.make("HalfCheetah"), "HalfCheetah"),
        "b4mrl-humanoid": lambda: single(client.make("Humanoid"), "Humanoid"),
        "b4mrl-8": lambda: batch(client.make_vec("HalfCheetah", 8), 8),
        "b4mrl-64": lambda: batch(client.make_vec("HalfCheetah", 64), 64),
        "b4mrl-halves": lambda: own_halves(client.make_vec("HalfCheetah", 64), 64),
    }


def gymnasium_loops() -> dict[str, Callable[[], Step]]:
    import gymnasium
    from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

    def make(environment: str = "HalfCheetah") -> Any:
        return gymnasium.make(f"{environment}-v5", disable_env_checker=True)

    return {
        "gymnasium-single": lambda: single(make(), "HalfCheetah"),
        "gymnasium-humanoid": lambda: single(make("Humanoid"), "Humanoid"),
        "gymnasium-sync-8": lambda: batch(SyncVectorEnv([make] * 8), 8),
        "gymnasium-async-8": lambda: batch(AsyncVectorEnv([make] * 8), 8),
    }


def envpool_loops() -> dict[str, Callable[[], Step]]:
    import envpool

    def make(count: int, **options: Any) -> Any:
        return envpool.make_gymnasium("HalfCheetah-v4", num_envs=count, **options)

    def send_and_receive() -> Step:
        vec = make(64, batch_size=32)
        vec.async_reset()
        return halves(vec, 64)

    return {
        "envpool-single": lambda: batch(make(1), 1),
        "envpool-8": lambda: batch(make(8), 8),
        "envpool-64": lambda: batch(make(64), 64),
        "envpool-halves": send_and_receive,
    }


def rate(step: Step, seconds: float) -> float:
    """Environment steps a second, measured for about `seconds`."""
    steps = 0
    start = time.perf_counter()
    while (elapsed := time.perf_counter() - start) < seconds:
        for _ in range(CALLS):
            steps += step()
    return steps / elapsed


def has(*modules: str) -> bool:
    return all(importlib.util.find_spec(module) is not None for module in modules)


def answer(link: socket.socket, endpoint: str) -> None:
    loops = own_loops(endpoint)
    if has("gymnasium", "mujoco"):
        loops |= gymnasium_loops()
    if has("envpool"):
        loops |= envpool_loops()
    started: dict[str, Step] = {}
    link.sendall(f"ready {' '.join(loops)}\n".encode())
    for line in link.makefile():
        name, seconds = line.split()
        if name not in started:
            started[name] = loops[name]()
        link.sendall(f"{rate(started[name], float(seconds))}\n".encode())


def main() -> None:
    link = socket.socket(fileno=0)
    try:
        if not has("b4mrl"):
            raise ImportError(
                f"{sys.executable} has no package b4mrl; activate a virtual environment in which "
                "`pip install ./client/python` was done"
            )
        answer(link, sys.argv[1])
    except Exception as error:
        link.sendall(f"failed {' '.join(str(error).split())}\n".encode())


if __name__ == "__main__":
    main()
