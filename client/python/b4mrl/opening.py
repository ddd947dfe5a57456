"""The opening of sessions and datasets.

A session is opened by the gateway, which names the worker to connect to; a dataset is opened by the
dataset worker.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import DTypeLike

from b4mrl import config, descriptions, errors, simulators
from b4mrl.spec import spec_of
from b4mrl.wire import arrays, checks, limits
from b4mrl.wire.connection import Connection
from b4mrl.wire.farewells import say_farewell
from b4mrl.wire.messages import AUTORESET_MODES, Request
from b4mrl.wire.routes import Routes
from b4mrl.wire.session import Session


@dataclass(frozen=True)
class Opening:
    """The arguments of Client.make or make_vec; `num_envs` 0 opens a session for queries alone.

    Those of a client have come through `plain`, so that no caller's object changes them later.
    """

    environment: str
    simulator: simulators.Simulator = None
    num_envs: int = 1
    seed: int | None = None
    dtype: DTypeLike = "float32"
    autoreset_mode: Any = "disabled"
    config: Mapping[str, Any] | None = None
    max_episode_steps: int | None = None
    deadline_ms: float | None = None
    ledger: int | None = None

    def request(self) -> Any:
        """The Open request. InvalidArgumentError: an argument is malformed or out of range."""
        request = Request()
        request.open.environment = checks.text("environment", self.environment)
        for item in simulators.parse(self.simulator):
            request.open.perturbations.add(name=item.name, argument=item.argument)
        request.open.num_envs = checks.unsigned("num_envs", self.num_envs, bits=32)
        if self.seed is not None:
            request.open.seed = checks.unsigned("seed", self.seed)
        request.open.autoreset_mode = int(
            AUTORESET_MODES.values_by_name[mode_name(self.autoreset_mode).upper()].number
        )
        request.open.observation_dtype = arrays.dtype_number(np.dtype(dtype_name(self.dtype)))
        request.open.config = config.to_json(self.config)
        request.open.with_infos = True
        request.open.ledger = self.ledger or 0
        return request


def open_session(endpoint: str, routes: Routes, opening: Opening, deadline_ms: float) -> Session:
    """Opens a session; `deadline_ms` limits the opening and each later request of the session."""
    steps = opening.max_episode_steps
    session = _open(endpoint, routes, opening.request(), deadline_ms)
    if steps is None or steps == session.spec.max_episode_steps:
        return session
    if steps == config.WITHOUT_LIMIT and config.counts_seconds(session.in_force.config):
        return session
    # The first session's configuration says which setting ends an episode; a second one sets it.
    with session:
        in_force, step_seconds = session.in_force.config, session.spec.step_seconds
        limited = config.with_limit(opening.config, steps, in_force, step_seconds)
    return _open(endpoint, routes, replace(opening, config=limited).request(), deadline_ms)


def dataset_request(
    name: str, corruption: simulators.Simulator, seed: int, transition_rule: str, environment: str
) -> Any:
    """The OpenDataset request. InvalidArgumentError: an argument is malformed."""
    request = Request()
    request.open_dataset.dataset = checks.text("name", name)
    for item in simulators.parse(corruption):
        request.open_dataset.corruptions.add(name=item.name, argument=item.argument)
    request.open_dataset.seed = checks.unsigned("seed", seed)
    request.open_dataset.transition_rule = checks.text("transition_rule", transition_rule)
    request.open_dataset.environment = checks.text("environment", environment)
    return request


def open_dataset(connection: Connection, request: Any, deadline_ms: float) -> Any:
    """The reply to an OpenDataset request.

    UnknownNameError: there is no such dataset; the message says how one of the project's is made.
    """
    try:
        return connection.call(request, bytearray(), deadline_ms).reply.open_dataset
    except errors.UnknownNameError as error:
        name = request.open_dataset.dataset
        is_missing = str(error).startswith("unknown dataset ")  # and no corruption
        has_version = name != errors.without_version(name)
        if not is_missing or has_version:  # those of a version come from elsewhere
            raise
        raise errors.UnknownNameError(
            f"{error}; `b4mrl dataset make {name}` makes it if `b4mrl list datasets` names it"
        ) from None


def _open(endpoint: str, routes: Routes, request: Any, deadline_ms: float) -> Session:
    # Open to the gateway and all requests to the session's worker carry the same token.
    token = secrets.token_bytes(limits.TOKEN_BYTES)
    opener = Connection(endpoint, token)
    worker = None
    asked = request.open
    try:
        reply = opener.call(request, bytearray(), deadline_ms).reply.open
        if (reply.num_envs, reply.observation_dtype) != (asked.num_envs, asked.observation_dtype):
            raise errors.InternalError("the server's reply does not fit what was opened")
        in_force, spec = descriptions.read(reply), spec_of(reply.info)
        dtype = arrays.dtype_of(reply.observation_dtype)
        worker = routes.reach(reply.port, token)
        session = Session(worker, in_force, spec, dtype, deadline_ms)
    except BaseException:
        say_farewell(opener)  # the daemon may have opened the session already
        if worker is not None:
            worker.close()
        raise
    opener.close()
    return session


def plain(**arguments: Any) -> dict[str, Any]:
    """Arguments of Client.make, make_vec and dataset, checked, as JSON has them.

    Numpy's numbers become Python's, and the caller's dicts and lists texts or copies.
    InvalidArgumentError: one of them is malformed or out of range.
    """
    return {
        name: _PLAIN[name](value) if name in _PLAIN else value for name, value in arguments.items()
    }


def _step_limit(steps: int | None) -> int | None:
    if steps is None:
        return None
    if steps == config.WITHOUT_LIMIT:
        return config.WITHOUT_LIMIT
    try:
        return checks.integer("max_episode_steps", steps, 1, config.MOST_STEPS)
    except errors.InvalidArgumentError as error:
        raise errors.InvalidArgumentError(f"{error}, or -1 for no limit") from None


def mode_name(mode: Any) -> str:
    """The name of an auto-reset mode, "same_step". InvalidArgumentError: there is no such mode.

    `mode` is that name, one of Gymnasium's AutoresetMode, or the value of one, "SameStep".
    """
    values = {member.value: member.name for member in AutoresetMode}
    name = str(mode.name if isinstance(mode, AutoresetMode) else values.get(str(mode), mode))
    if name.upper() not in list(AUTORESET_MODES.values_by_name):
        known = ", ".join(name.lower() for name in AUTORESET_MODES.values_by_name)
        raise errors.InvalidArgumentError(
            f"autoreset_mode is {mode!r}, allowed: {known}, or one of Gymnasium's AutoresetMode"
        )
    return name.lower()


def dtype_name(dtype: DTypeLike) -> str:
    """The name of `dtype`. InvalidArgumentError: it is neither float32 nor float64."""
    try:
        kind = np.dtype(np.void if dtype is None else dtype)  # None would mean float64
    except (TypeError, UnicodeEncodeError):
        kind = np.dtype(np.void)
    if kind not in (np.float32, np.float64):
        raise errors.InvalidArgumentError(f"dtype is {dtype!r}, allowed: float32, float64")
    return kind.name


def _optional(convert: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else convert(value)


_PLAIN: dict[str, Callable[[Any], Any]] = {
    "simulator": simulators.plain,
    "corruption": lambda value: simulators.plain(value, "corruption"),
    "config": config.plain,
    "seed": _optional(lambda value: checks.unsigned("seed", value)),
    "num_envs": lambda value: checks.integer("num_envs", value, 1, limits.MAX_LANES_PER_SESSION),
    "dtype": dtype_name,
    "autoreset_mode": mode_name,
    "max_episode_steps": _step_limit,
    "deadline_ms": _optional(lambda value: checks.deadline_ms(value, 0)),
}
