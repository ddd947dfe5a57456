"""Agents: policies in files, which `b4mrl train` writes or save_agent, as functions to actions.

An agent file is HDF5 with D4RL's layout of a behaviour policy under `metadata/policy`. B4MRL's
files also hold the length of the observation history, the mask of observed dimensions, and the
normalisation of observations.
"""

from __future__ import annotations

import copy
import os
import reprlib
import secrets
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from b4mrl.agent_file import (
    MAX_HIDDEN_LAYERS,
    MAX_HISTORY,
    MAX_TEXT_BYTES,
    MAX_UPDATES,
    MAX_WIDTH,
    AgentFile,
    Layer,
    Vector,
)
from b4mrl.display import Shown
from b4mrl.errors import DataLossError, InvalidArgumentError
from b4mrl.wire import checks, limits

_ACTIVATIONS = ("relu", "tanh")


class Policy(Shown):
    """A deterministic policy: `action = policy(observation)`.

    `observation` is one observation or a batch of n, float32 or float64, of any shape with
    observation_size numbers for each; `action` is float32 of shape (action_size,) or
    (n, action_size). Actions agree with the C++ learners' to rounding, not bit for bit.

    A policy with a history remembers the last observations: call `reset` when an episode starts. In
    a batch, each row has its own history, and `reset(rows)` clears those of some rows. Which row is
    which is told by its place alone, so a batch has as many rows as the last one, unless `reset()`
    came in between: InvalidArgumentError. Rows of episodes that have ended stay in their places.
    Thread rule: one thread at a time.

    Attributes:
        observation_size, action_size: numbers of an observation and of an action.
        history_length: number of latest observations that the policy looks at; 1 for no history.
        environment: name of the environment that the policy was trained for; "" if not recorded.
        algorithm: name of the algorithm that trained the policy; "" if not recorded.
    """

    def __init__(self, file: AgentFile) -> None:
        self.environment = _text(file, "metadata/environment")
        self.algorithm = _text(file, "metadata/algorithm")
        file.check_provenance()
        self._hidden = _choose(file, "nonlinearity", {"relu": _relu, "tanh": np.tanh})
        is_noisy = _choose(file, "output_distribution", {"tanh_gaussian": True, "tanh": False})
        self._layers = _layers(file, is_noisy)
        self.history_length, self.action_size = 1, len(self._layers[-1][1])
        if _entry("history_length") in file:
            self.history_length = file.number(_entry("history_length"), MAX_HISTORY)
        inputs = self._layers[0][0].shape[1]
        if self.history_length < 1 or inputs % self.history_length:
            raise DataLossError(
                f"{_entry('history_length')} is {self.history_length}, allowed: a divisor of "
                f"{inputs} inputs"
            )
        self.observation_size = inputs // self.history_length
        size = self.observation_size
        self._mask = file.vector(_entry("observation_mask"), size, 1) != 0
        self._mean = _finite(file, "observation_mean", size, 0)
        self._std = _finite(file, "observation_std", size, 1)
        if not (self._std > 0).all():
            raise DataLossError(f"{_entry('observation_std')} has a number that is not above 0")
        self._scale = _finite(file, "action_scale", self.action_size, 1)
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
        """Starts new episodes for `rows` of the last batch, numbers or a bool mask; None: for all.

        InvalidArgumentError: the last batch has no such rows.
        """
        if rows is None or self._history is None:
            self._history = None
            return
        count = len(self._starts)
        allowed = f"numbers in 0..{count - 1} or a bool mask of shape ({count},)"
        chosen = checks.array("rows", rows, allowed)
        try:
            self._starts[chosen if chosen.size else []] = True
        except IndexError as error:
            raise InvalidArgumentError(
                f"rows are {reprlib.repr(rows)}, allowed: {allowed} ({error})"
            ) from None

    def unmasked(self) -> Policy:
        """The same policy without its mask: it sees what was hidden from it in its training."""
        other = copy.copy(self)
        other._mask = np.ones_like(self._mask)
        other._history = None
        return other

    def __call__(self, observation: ArrayLike) -> Vector:
        size = self.observation_size
        allowed = f"numbers of shape ({size},) or (n, {size})"
        given = checks.array("observation", observation, allowed, np.float32)
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
        if self._history is not None and len(self._history) != len(rows):
            raise InvalidArgumentError(
                f"observation has {len(rows)} rows, allowed: {len(self._history)}, each with the "
                "history of its place in the last batch; call reset() before another number of rows"
            )
        if self._history is None:
            self._history = np.zeros((len(rows), self.history_length, rows.shape[1]), np.float32)
            self._starts = np.ones(len(rows), np.bool_)
        self._history = np.roll(self._history, -1, axis=1)
        self._history[:, -1] = rows
        self._history[self._starts] = rows[self._starts, None]
        self._starts[:] = False
        return self._history.reshape(len(rows), -1)


def load_agent(path: str | os.PathLike[str]) -> Policy:
    """Reads an agent file, or the behaviour policy in a dataset file of D4RL.

    OSError: the file cannot be read. DataLossError: it holds no agent, or a malformed one; the
    message names the entry.
    """
    import h5py  # only here: HDF5 is slow to import

    source = checks.path("path", path)
    try:
        file = h5py.File(source, "r")
    except OSError as error:  # whose text need not name the file
        if error.errno is not None:
            raise OSError(error.errno, os.strerror(error.errno), str(source)) from None
        raise OSError(f"{source} cannot be read: {error}") from None
    with file:
        entries = AgentFile(file)
        if "metadata/policy" not in entries:
            raise DataLossError(f"{source} holds no agent: it has no metadata/policy")
        try:
            return Policy(entries)
        except DataLossError as error:
            raise DataLossError(f"{source}: {error}") from None


def save_agent(
    path: str | os.PathLike[str],
    layers: Sequence[tuple[Any, Any]],
    activation: str = "relu",
    *,
    environment: str = "",
    mask: ArrayLike | None = None,
    observation_mean: ArrayLike | None = None,
    observation_std: ArrayLike | None = None,
    action_scale: ArrayLike | None = None,
    history_length: int = 1,
    algorithm: str = "",
    seed: int = 0,
    updates: int = 0,
) -> None:
    """Writes an agent file, which load_agent reads and `b4mrl evaluate` scores.

    The policy is action_scale * tanh(last layer), where every other layer is followed by
    `activation`, and the input is (observation - observation_mean) / observation_std, 0 where the
    mask is False. The file appears whole or not at all; its folder is made if it is missing.

    Args:
        layers: (weight, bias) of each layer, arrays or PyTorch tensors of shapes (outputs, inputs)
            and (outputs,), as torch.nn.Linear has them.
        activation: "relu" or "tanh".
        environment: name of the environment in which the agent acts. "": any of its sizes.
        mask: bool for each dimension of an observation: whether the policy sees it, such as
            Benchmark.mask. None: all of them.
        observation_mean, observation_std: for each dimension of an observation. None: 0 and 1.
            A deviation is above 0, or 0 where the mask is False.
        action_scale: largest action of each dimension. None: 1.
        history_length: number of latest observations that the first layer takes, oldest first.
        algorithm, seed, updates: what trained the agent; kept in the file.

    InvalidArgumentError: what no agent file can hold; the message names what is allowed.
    """
    target = checks.path("path", path)
    if not target.name:
        raise InvalidArgumentError(f"path is {str(path)!r}, allowed: the path of a file")
    if not isinstance(activation, str) or activation not in _ACTIVATIONS:
        raise InvalidArgumentError(
            f"activation is {activation!r}, allowed: {', '.join(_ACTIVATIONS)}"
        )
    read = _readable_layers(layers)
    inputs, actions = read[0][0].shape[1], len(read[-1][1])
    history_length = checks.integer("history_length", history_length, 1, MAX_HISTORY)
    if inputs % history_length:
        raise InvalidArgumentError(
            f"history_length is {history_length}, allowed: a divisor of the first layer's "
            f"{inputs} inputs, at most {MAX_HISTORY}"
        )
    size = inputs // history_length
    sees = _given_vector("mask", mask, size, 1) != 0
    entries: dict[str, Any] = {
        "environment": _given_text("environment", environment),
        "algorithm": _given_text("algorithm", algorithm),
        "seed": str(checks.unsigned("seed", seed)),
        "iteration": checks.integer("updates", updates, 0, MAX_UPDATES),
        "policy/nonlinearity": activation,
        "policy/output_distribution": "tanh",
        "policy/history_length": history_length,
        "policy/observation_mask": sees,
        "policy/observation_mean": _given_vector("observation_mean", observation_mean, size, 0),
        "policy/observation_std": _given_std(observation_std, sees),
        "policy/action_scale": _given_vector("action_scale", action_scale, actions, 1),
    }
    names = [*(f"fc{i}" for i in range(len(read) - 1)), "last_fc"]
    for name, (weight, bias) in zip(names, read):
        entries |= {f"policy/{name}/weight": weight, f"policy/{name}/bias": bias}
    _write(target, entries)


def _write(target: Path, entries: Mapping[str, Any]) -> None:
    """Writes the entries of `metadata`, whole or not at all; makes the file's folder."""
    import h5py  # only here: HDF5 is slow to import

    target.parent.mkdir(parents=True, exist_ok=True)
    unfinished = target.with_name(f".{target.name}.{secrets.token_hex(8)}")
    try:
        with h5py.File(unfinished, "w", libver=("earliest", "v110")) as file:
            for name, value in entries.items():
                file[f"metadata/{name}"] = value
        with unfinished.open("rb") as written:
            os.fsync(written.fileno())  # else a machine that fails may leave an empty file
        unfinished.replace(target)
    finally:
        unfinished.unlink(missing_ok=True)


def _readable_layers(layers: Sequence[tuple[Any, Any]]) -> list[Layer]:
    """The layers as arrays. InvalidArgumentError: they make no network that a file can hold."""
    try:
        pairs = [(weight, bias) for weight, bias in layers]
    except (TypeError, ValueError):
        raise InvalidArgumentError(
            f"layers are {reprlib.repr(layers)}, allowed: a list of pairs (weight, bias)"
        ) from None
    if not 1 <= len(pairs) <= MAX_HIDDEN_LAYERS + 1:
        raise InvalidArgumentError(
            f"there are {len(pairs)} layers, allowed: 1..{MAX_HIDDEN_LAYERS + 1}"
        )
    read: list[Layer] = []
    for i, (weight, bias) in enumerate(pairs):
        matrix = _numbers(f"the weight of layers[{i}]", weight)
        vector = _numbers(f"the bias of layers[{i}]", bias)
        inputs = len(read[-1][1]) if read else None
        fits = matrix.ndim == 2 and vector.shape == matrix.shape[:1]
        fits = fits and inputs in (None, matrix.shape[1])
        if not fits or not 0 < min(matrix.shape) <= max(matrix.shape) <= MAX_WIDTH:
            raise InvalidArgumentError(
                f"layers[{i}] has a weight of shape {matrix.shape} and a bias of shape "
                f"{vector.shape}, allowed: (outputs, {inputs or 'inputs'}) and "
                f"(outputs,), both of 1..{MAX_WIDTH}"
            )
        if not (np.isfinite(matrix).all() and np.isfinite(vector).all()):
            raise InvalidArgumentError(f"layers[{i}] has a number that is not finite")
        read.append((matrix, vector))
    if len(read[-1][1]) > limits.MAX_ACTION_DIMENSIONS:
        raise InvalidArgumentError(
            f"the last layer has {len(read[-1][1])} outputs, allowed: "
            f"1..{limits.MAX_ACTION_DIMENSIONS}"
        )
    return read


def _numbers(name: str, given: Any) -> NDArray[np.float32]:
    """An array, or a PyTorch tensor on whatever device, as float32."""
    value = given.detach().cpu() if hasattr(given, "detach") else given
    return checks.array(name, value, "numbers", np.float32)


def _given_text(name: str, given: Any) -> str:
    value = checks.text(name, given)
    if len(value.encode()) > MAX_TEXT_BYTES or "\0" in value:
        raise InvalidArgumentError(
            f"{name} is {reprlib.repr(value)}, allowed: at most {MAX_TEXT_BYTES} bytes, none of "
            "them 0"
        )
    return value


def _given_vector(name: str, given: Any, size: int, default: float) -> Vector:
    value = _numbers(name, np.full(size, default) if given is None else given).reshape(-1)
    if len(value) != size or not np.isfinite(value).all():
        raise InvalidArgumentError(
            f"{name} has {len(value)} entries, allowed: {size}, all of them finite"
        )
    return value


def _given_std(given: Any, sees: NDArray[np.bool_]) -> Vector:
    """The deviations, above 0: for the 0 of a dimension that the mask hides, readers get 1."""
    std = _given_vector("observation_std", given, len(sees), 1)
    std = np.where(~sees & (std == 0), np.float32(1), std)
    if wrong := np.flatnonzero(std <= 0).tolist():
        raise InvalidArgumentError(
            f"observation_std[{wrong[0]}] is {std[wrong[0]]}, allowed: above 0, or 0 where the mask "
            "is False; add a small number to all of them, such as 0.001"
        )
    return std


def _relu(values: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.maximum(values, 0)


def _entry(name: str) -> str:
    return f"metadata/policy/{name}"


def _text(file: AgentFile, path: str) -> str:
    return file.text(path) if path in file else ""


def _choose(file: AgentFile, name: str, known: dict[str, Any]) -> Any:
    value = file.text(_entry(name))
    if value not in known:
        raise DataLossError(f"{_entry(name)} is {value!r}, allowed: {', '.join(known)}")
    return known[value]


def _layers(file: AgentFile, is_noisy: bool) -> list[Layer]:
    """The layers of an agent, each of which takes the outputs of that before it.

    Args:
        is_noisy: whether the agent has a layer for the deviations of its noise, which is checked,
            too. Deterministic actions do not need it.
    """
    names: list[str] = []
    while len(names) <= MAX_HIDDEN_LAYERS and _entry(f"fc{len(names)}") in file:
        names.append(f"fc{len(names)}")
    if len(names) > MAX_HIDDEN_LAYERS:
        raise DataLossError(
            f"there are {len(names)} hidden layers or more, allowed: 0..{MAX_HIDDEN_LAYERS}"
        )
    for number in range(len(names) + 1, MAX_HIDDEN_LAYERS + 1):
        if _entry(f"fc{number}") in file:
            raise DataLossError(f"{_entry(f'fc{number}')} is there without fc{len(names)}")
    layers: list[Layer] = []
    for name in [*names, "last_fc"]:
        weight, bias = file.layer(_entry(name))
        if layers and weight.shape[1] != len(layers[-1][1]):
            raise DataLossError(
                f"{_entry(name)} has {weight.shape[1]} inputs, allowed: {len(layers[-1][1])}"
            )
        layers.append((weight, bias))
    shape = layers[-1][0].shape
    most = limits.MAX_ACTION_DIMENSIONS
    if shape[0] > most:
        raise DataLossError(f"{_entry('last_fc')} has {shape[0]} outputs, allowed: 1..{most}")
    if is_noisy and (noise := file.layer(_entry("last_fc_log_std"))[0].shape) != shape:
        raise DataLossError(f"{_entry('last_fc_log_std')} has shape {noise}, allowed: {shape}")
    return layers


def _finite(file: AgentFile, name: str, size: int, default: float) -> Vector:
    values = file.vector(_entry(name), size, default)
    if not np.isfinite(values).all():
        raise DataLossError(f"{_entry(name)} has a number that is not finite")
    return values
