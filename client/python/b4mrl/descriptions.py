"""What the daemon says of itself, of what it has, and of what it has in force."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from b4mrl.display import Record
from b4mrl.errors import InternalError
from b4mrl.simulators import NamedArgument
from b4mrl.wire.messages import AUTORESET_MODES

T = TypeVar("T")


@dataclass(frozen=True, repr=False)
class Preset(Record):
    """A named strength of a perturbation, as the paper has it: "gravity" of HalfCheetah is 2."""

    name: str
    environment: str
    argument: str


@dataclass(frozen=True, repr=False)
class Perturbation(Record):
    """A kind of perturbation.

    Attributes:
        name: of the parametric form, "gravity".
        parameter, type: what its argument is: "factor", a "number", "integer", "dimensions" or
            "file".
        low, high: the argument's range.
        corrupts_datasets: whether it may be a dataset's corruption too.
        environments: that can be perturbed so.
        files: of type "file": what lies in the models folder.
    """

    name: str
    parameter: str
    type: str
    low: float
    high: float
    description: str
    corrupts_datasets: bool
    presets: tuple[Preset, ...]
    environments: tuple[str, ...]
    files: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class WorkerStatus(Record):
    """A process of the daemon. Counts are since the daemon's start, rates of the last second."""

    role: str
    process_id: int
    restarts: int
    sessions: int
    steps: int
    query_rows: int
    requests: int
    errors: int
    steps_per_second: float


@dataclass(frozen=True, repr=False)
class SessionStatus(Record):
    """A session of any client."""

    environment: str
    perturbations: str
    num_envs: int
    worker: int
    steps: int
    idle_ms: int


@dataclass(frozen=True, repr=False)
class ServerStatus(Record):
    """The daemon. Of its `session_count` sessions, `sessions` has the first 256."""

    uptime_ms: int
    workers: tuple[WorkerStatus, ...]
    sessions: tuple[SessionStatus, ...]
    session_count: int


@dataclass(frozen=True, repr=False)
class DatasetInfo(Record):
    """A dataset's file.

    Attributes:
        rows, sha256: 0 and "" while it has not been imported.
        behaviour_policy: what recorded it, in the file's words.
    """

    name: str
    rows: int
    file_bytes: int
    sha256: str
    behaviour_policy: str


@dataclass(frozen=True, repr=False)
class SessionInForce(Record):
    """What a session runs with.

    Attributes:
        perturbations: presets resolved to their parametric form.
        seed: of environment 0; environment i has seed + i.
        autoreset_mode: "next_step", "same_step" or "disabled".
        config: all settings of the environment, those that nobody gave included.
        experiment_id: equal ids mean equal numbers.
    """

    environment: str
    perturbations: tuple[NamedArgument, ...]
    num_envs: int
    seed: int
    autoreset_mode: str
    config: dict[str, Any]
    experiment_id: str
    with_infos: bool


@dataclass(frozen=True, repr=False)
class DatasetInForce(Record):
    """What a dataset is served with.

    Attributes:
        fingerprint: stands for the file's contents, the corruptions and the transition rule.
        rows: under the transition rule.
        corruptions: presets resolved to their parametric form.
        environment: that the dataset was recorded in; "" if neither the file nor its name tells.
    """

    fingerprint: str
    info: DatasetInfo
    rows: int
    observation_size: int
    action_size: int
    corruptions: tuple[NamedArgument, ...]
    hidden_dimensions: tuple[int, ...]
    environment: str


_KINDS: dict[str, type[Any]] = {
    "PresetInfo": Preset,
    "PerturbationInfo": Perturbation,
    "WorkerStatus": WorkerStatus,
    "SessionStatus": SessionStatus,
    "ServerStatusReply": ServerStatus,
    "DatasetInfo": DatasetInfo,
    "OpenReply": SessionInForce,
    "OpenDatasetReply": DatasetInForce,
    "NamedArgument": NamedArgument,
}
_READERS: dict[str, Callable[[Any], Any]] = {
    "autoreset_mode": lambda number: AUTORESET_MODES.values_by_number[number].name.lower(),
    "config": lambda text: json.loads(text or "{}"),
}


def read(message: Any) -> Any:
    """The description that a message of b4mrl.proto holds. InternalError: it makes no sense."""
    try:
        return _read(message)
    except (KeyError, ValueError) as error:
        raise InternalError(f"unreadable reply: {message.DESCRIPTOR.name}: {error}") from error


def _read(message: Any) -> Any:
    kind = _KINDS[message.DESCRIPTOR.name]
    return kind(**{each.name: _value(message, each.name) for each in fields(kind)})


def _value(message: Any, name: str) -> Any:
    value = getattr(message, name)
    if name in _READERS:
        return _READERS[name](value)
    if hasattr(value, "DESCRIPTOR"):
        return _read(value)
    if isinstance(value, str | int | float):
        return value
    return tuple(_read(item) if hasattr(item, "DESCRIPTOR") else item for item in value)
