"""Gymnasium's registry: `gym.make("b4mrl:b4mrl/HalfCheetah-v0", simulator="gravity")`.

Importing b4mrl registers the five environments that the daemon is known for; `register` adds
others, such as those of a daemon with environments of its own. An id is looked up in the daemon
only when it is made.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym

from b4mrl.client import Client
from b4mrl.environment import Environment
from b4mrl.serve import default_endpoint
from b4mrl.vector_environment import VectorEnvironment

_KNOWN = ("HalfCheetah", "Hopper", "Walker2d", "Humanoid", "Highway")


def register(names: Iterable[str] = _KNOWN) -> None:
    """Registers "b4mrl/NAME-v0" for every name that is not registered yet.

    `gym.make` then takes the arguments of Client.make, `gym.make_vec` those of Client.make_vec, and
    both `endpoint`: None for $B4MRL_ENDPOINT, or for a private daemon that the process shares.
    """
    for name in names:
        environment_id = f"b4mrl/{name}-v0"
        if environment_id not in gym.registry:
            gym.register(
                id=environment_id,
                entry_point="b4mrl.registration:make",
                vector_entry_point="b4mrl.registration:make_vec",
                kwargs={"environment": name},
            )


def make(environment: str, endpoint: str | None = None, **options: Any) -> Environment:
    """The entry point of gym.make."""
    return connect(endpoint).make(environment, **options)


def make_vec(
    environment: str, num_envs: int, endpoint: str | None = None, **options: Any
) -> VectorEnvironment:
    """The entry point of gym.make_vec."""
    return connect(endpoint).make_vec(environment, num_envs, **options)


def connect(endpoint: str | None = None, deadline_ms: float | None = None) -> Client:
    """Connects to a daemon.

    Args:
        endpoint: "tcp://HOST:PORT" or "ipc://PATH". None: $B4MRL_ENDPOINT, or a private daemon that
            this process shares.
        deadline_ms: of each request. None: ten seconds.

    Raises:
        UnavailableError: nobody answers there.
        VersionMismatchError: it speaks another version of the protocol.
    """
    options = {} if deadline_ms is None else {"deadline_ms": deadline_ms}
    return Client(endpoint or default_endpoint(), **options)
