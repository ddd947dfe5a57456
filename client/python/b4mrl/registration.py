"""Entries in Gymnasium's registry: `gym.make("b4mrl:b4mrl/HalfCheetah-v0", simulator="gravity")`.

Importing b4mrl registers the names below; `register` adds names of other environments that a daemon
has. Whether the daemon has an environment shows only in gym.make.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable
from typing import Any, TypeVar

import gymnasium as gym

from b4mrl.client import Client, call_once
from b4mrl.environment import Environment
from b4mrl.hosted import RENDER_MODES
from b4mrl.serve import PrivateDaemon, default_endpoint
from b4mrl.vector_environment import VectorEnvironment

T = TypeVar("T")

_KNOWN = ("HalfCheetah", "Hopper", "Walker2d", "Humanoid", "Highway")


def register(names: str | Iterable[str] = _KNOWN) -> None:
    """Registers "b4mrl/NAME-v0" for every NAME, or for one, that is not registered yet.

    `gym.make` then takes the arguments of Client.make, `gym.make_vec` those of Client.make_vec:
    `max_episode_steps=-1` lifts the limit of steps, but not Highway's `duration` in seconds. Both
    also take `endpoint`, the daemon's address. None: $B4MRL_ENDPOINT, else one private daemon for
    all environments of the process.
    """
    for name in (names,) if isinstance(names, str) else names:
        environment_id = f"b4mrl/{name}-v0"
        if environment_id not in gym.registry:
            gym.register(
                id=environment_id,
                entry_point="b4mrl.registration:make",
                vector_entry_point="b4mrl.registration:make_vec",
                kwargs={"environment": name},
            )


def make(environment: str, endpoint: str | None = None, **options: Any) -> Environment:
    """The entry point that gym.make calls for a registered name."""
    limit = _limit_of_the_caller()
    if limit is not None:
        options["max_episode_steps"] = limit
    return call_once(Client.make, _endpoint(endpoint), None, environment, **options)


# gym.make adds "human" and "rgb_array_list" by wrappers, if the entry point, usually a class, says
# that there is "rgb_array". The wrappers take the frames per second from the environment.
setattr(make, "metadata", {"render_modes": list(RENDER_MODES)})


def make_vec(
    environment: str, num_envs: int, endpoint: str | None = None, **options: Any
) -> VectorEnvironment:
    """The entry point that gym.make_vec calls for a registered name."""
    return call_once(Client.make_vec, _endpoint(endpoint), None, environment, num_envs, **options)


def connect(
    endpoint: str | PrivateDaemon | None = None, deadline_ms: float | None = None
) -> Client:
    """Connects to a daemon.

    Args:
        endpoint: "tcp://HOST:PORT" or "ipc://PATH" of the daemon's gateway, or what `serve` has
            returned, which the client then keeps. None: $B4MRL_ENDPOINT, else one private daemon
            for all clients of this process.
        deadline_ms: time limit of each request, in milliseconds. None: two minutes, but ten seconds
            for the first connection.

    Raises:
        UnavailableError: no daemon answers at `endpoint`.
        VersionMismatchError: the daemon speaks another version of the protocol.
    """
    return Client(_endpoint(endpoint), deadline_ms)


def _endpoint(named: T | None) -> T | str:
    return default_endpoint() if named is None else named


def _limit_of_the_caller() -> int | None:
    """The `max_episode_steps` argument of the running gym.make; None if the caller gave none.

    gym.make never passes this argument to an entry point: it wraps the finished environment into a
    TimeLimit, which can end an episode before the daemon does but not after. So that
    max_episode_steps=2000 gives 2,000 steps, the daemon must know the number when the session is
    opened, and the local variables of gym.make are the only place that has it by then. A wrapper in
    the spec (`additional_wrappers`) would see the TimeLimit, but gym.make_vec refuses specs with
    both wrappers and a vector entry point. If gym.make ever changes its variables, the daemon keeps
    its own limit, and the TimeLimit still shortens episodes.
    """
    frame = inspect.currentframe()
    entry_point = frame and frame.f_back
    caller = entry_point and entry_point.f_back
    if caller is None or caller.f_code is not gym.make.__code__:
        return None
    asked = caller.f_locals.get("max_episode_steps")
    if asked is None:  # gym.make(env.spec) takes the limit from the spec
        asked = getattr(caller.f_locals.get("env_spec"), "max_episode_steps", None)
    return asked
