"""Converts an environment's settings to the JSON text of the Open request."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from b4mrl.errors import InvalidArgumentError
from b4mrl.wire import checks

WITHOUT_LIMIT = -1  # as a number of steps, as in gym.make
MOST_STEPS = 2**32 - 1  # what a task that counts steps has in place of no limit


def plain(config: Mapping[str, Any] | None) -> Any:
    """A copy of `config` of what JSON has: dicts, lists, numbers, strings, booleans and None.

    Values may be numbers, strings, booleans, None, and lists, tuples, arrays or dicts of these. An
    infinite number, as in `healthy_z_range=(0.7, inf)`, becomes None, which the daemon reads as an
    unbounded end of the range. InvalidArgumentError: no dict, another type of value, or NaN.
    """
    if config is None:
        return None
    return _plain(checks.mapping("config", config, "a dict from names of settings"), "config")


def to_json(config: Mapping[str, Any] | None) -> str:
    """`plain(config)` as a JSON object; "" if it is None or empty. Raises as `plain`."""
    return json.dumps(plain(config), allow_nan=False) if config else ""


def with_limit(
    config: Mapping[str, Any] | None,
    steps: int,
    in_force: Mapping[str, Any],
    step_seconds: float,
) -> dict[str, Any]:
    """`config` with an episode limit of `steps`, under the environment's own name for the setting.

    Args:
        steps: number of steps after which an episode is truncated; WITHOUT_LIMIT: never, in a task
            that counts steps.
        in_force: all settings of the environment; Highway's limit is a `duration` in seconds.
        step_seconds: simulated seconds of one step.
    """
    value: float
    name, value = "max_episode_steps", MOST_STEPS if steps == WITHOUT_LIMIT else steps
    if counts_seconds(in_force):  # the first step whose end reaches the duration ends the episode
        name, value = "duration", (steps - 0.5) * step_seconds
    given = dict(config or {})
    if name in given:
        raise InvalidArgumentError(
            f"max_episode_steps is {steps} and config[{name!r}] is {given[name]!r}, "
            "allowed: one of the two"
        )
    return given | {name: value}


def counts_seconds(in_force: Mapping[str, Any]) -> bool:
    """Whether an environment with these settings limits an episode's seconds, not its steps."""
    return "duration" in in_force


def _plain(value: Any, name: str) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item, f"{name}[{key!r}]") for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item, f"{name}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, float) and not math.isnan(value):
        return None if math.isinf(value) else value
    if value is None or isinstance(value, bool | int | str):
        return value
    raise InvalidArgumentError(
        f"{name} is {value!r}, allowed: numbers, texts, booleans, None, and lists or dicts of them"
    )
