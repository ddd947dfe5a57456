"""Agents: policies from files of `b4mrl train` or D4RL, as functions from observations to actions.

An agent file is HDF5 with D4RL's layout of a behaviour policy under `metadata/policy`. B4MRL's
files also hold the length of the observation history, the mask of observed dimensions, and the
normalisation of observations.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from b4mrl.display import Shown
from b4mrl.errors import DataLossError, InvalidArgumentError

Vector = NDArray[np.float32]
Layer = tuple[NDArray[np.float32], Vector]  # weight (outputs, inputs) and bias (outputs,)


class Policy(Shown):
    """A deterministic policy: `action = policy(observation)`.

    `observation` is one observation or a batch of n, float32 or float64, of any shape with
    observation_size numbers for each; `action` is float32 of shape (action_size,) or
    (n, action_size). Actions agree with the C++ learners' to rounding, not bit for bit.

    A policy with a history remembers the last observations: call `reset` when an episode starts. In
    a batch, each row has its own history, and `reset(rows)` clears those of some rows. Thread rule:
    one thread at a time.

    Attributes:
        observation_size, action_size: numbers of an observation and of an action.
        history_length: number of latest observations that the policy looks at; 1 for no history.
        environment: name of the environment that the policy was trained for; "" if not recorded.
        algorithm: name of the algorithm that trained the policy; "" if not recorded.
    """

    def __init__(self, metadata: Any) -> None:
        group = metadata["policy"]
        self.environment = _text(metadata, "environment")
        self.algorithm = _text(metadata, "algorithm")
        self._layers: list[Layer] = []
        while f"fc{len(self._layers)}" in group:
            self._layers.append(_layer(group[f"fc{len(self._layers)}"]))
        self._layers.append(_layer(group["last_fc"]))
        self._hidden = _choose(group, "nonlinearity", {"relu": _relu, "tanh": np.tanh})
        _choose(group, "output_distribution", {"tanh_gaussian": None, "tanh": None})
        for (_, bias), (weight, _) in zip(self._layers, self._layers[1:]):
            if weight.shape[1] != len(bias):
                raise DataLossError(f"a layer of {weight.shape} follows one of {len(bias)} outputs")
        self.history_length = int(group["history_length"][()]) if "history_length" in group else 1
        self.action_size = len(self._layers[-1][1])
        inputs = self._layers[0][0].shape[1]
        if self.history_length < 1 or inputs % self.history_length:
            raise DataLossError(
                f"history_length is {self.history_length}, allowed: a divisor of {inputs} inputs"
            )
        self.observation_size = inputs // self.history_length
        size = self.observation_size
        self._mask = _vector(group, "observation_mask", np.ones(size)) != 0
        self._mean = _vector(group, "observation_mean", np.zeros(size))
        self._std = _vector(group, "observation_std", np.ones(size))
        self._scale = _vector(group, "action_scale", np.ones(self.action_size))
        self._history: NDArray[np.float32] | None = None  # (n, history, size), oldest first
        self._starts = np.ones(0, np.bool_)  # rows whose next observation is an episode's first

    def _facts(self) -> Mapping[str, Any]:
        return {
            "environment": self.environment,
            "algorithm": self.algorithm,
            "observation_size": self.observation_size,
            "action_size": self.action_size,
            "history_length": self.history_length,
            "layers": tuple(len(bias) for _, bias in self._layers),
        }

    def reset(self, rows: ArrayLike | None = None) -> None:
        """Starts new episodes for `rows`, numbers or a bool mask; None: for all rows."""
        if rows is None or self._history is None:
            self._history = None
        else:
            self._starts[np.asarray(rows)] = True

    def unmasked(self) -> Policy:
        """The same policy without its mask: it sees what was hidden from it in its training."""
        other = copy.copy(self)
        other._mask = np.ones_like(self._mask)
        other._history = None
        return other

    def __call__(self, observation: ArrayLike) -> Vector:
        given = np.asarray(observation, np.float32)
        size = self.observation_size
        single = given.size == size and (given.ndim < 2 or given[0].size < size)
        if given.size == 0 or given.size % size or not (single or given[0].size == size):
            raise InvalidArgumentError(
                f"observation has shape {given.shape}, allowed: ({size},) or (n, {size})"
            )
        rows = np.where(self._mask, given.reshape(-1, size), 0)
        rows = np.where(self._mask, (rows - self._mean) / self._std, 0)
        values = self._with_history(rows)
        for weight, bias in self._layers[:-1]:
            values = self._hidden(values @ weight.T + bias)
        weight, bias = self._layers[-1]
        actions: Vector = self._scale * np.tanh(values @ weight.T + bias)
        return actions[0] if single else actions

    def _with_history(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        if self.history_length == 1:
            return rows
        if self._history is None or len(self._history) != len(rows):
            self._history = np.zeros((len(rows), self.history_length, rows.shape[1]), np.float32)
            self._starts = np.ones(len(rows), np.bool_)
        self._history = np.roll(self._history, -1, axis=1)
        self._history[:, -1] = rows
        self._history[self._starts] = rows[self._starts, None]
        self._starts[:] = False
        return self._history.reshape(len(rows), -1)


def load_agent(path: str | os.PathLike[str]) -> Policy:
    """Reads an agent file, or the behaviour policy in a dataset file of D4RL.

    OSError: the file cannot be read. DataLossError: it holds no agent, or a malformed one.
    """
    import h5py  # only here: HDF5 is slow to import

    with h5py.File(path, "r") as file:
        try:
            return Policy(file["metadata"])
        except KeyError as error:
            raise DataLossError(f"{os.fspath(path)} holds no agent: {error}") from None


def _relu(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.maximum(values, 0)


def _text(group: Any, name: str) -> str:
    value = group[name][()] if name in group else ""
    return value.decode() if isinstance(value, bytes) else str(value)


def _choose(group: Any, name: str, known: dict[str, Any]) -> Any:
    value = _text(group, name)
    if value not in known:
        raise DataLossError(f"{name} is {value!r}, allowed: {', '.join(known)}")
    return known[value]


def _layer(group: Any) -> Layer:
    weight, bias = (np.asarray(group[name], np.float32) for name in ("weight", "bias"))
    if weight.ndim != 2 or bias.shape != weight.shape[:1]:
        raise DataLossError(f"{group.name}: weight {weight.shape} and bias {bias.shape} do not fit")
    if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
        raise DataLossError(f"{group.name} has a number that is not finite")
    return weight, bias


def _vector(group: Any, name: str, default: NDArray[Any]) -> Vector:
    value = np.asarray(group[name] if name in group else default, np.float32).reshape(-1)
    if value.shape != default.shape:
        raise DataLossError(f"{name} has {value.size} entries, allowed: {default.size}")
    return value
