"""Descriptions that the daemon sends: its catalogue and status, and settings in force."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from b4mrl.display import Record
from b4mrl.errors import InternalError
from b4mrl.simulators import NamedArgument
from b4mrl.values import Value
from b4mrl.wire.messages import AUTORESET_MODES

T = TypeVar("T")


@dataclass(frozen=True, repr=False)
class Preset(Record):
    """A perturbation with the paper's value for one environment: "gravity" of HalfCheetah is 2."""

    name: str
    environment: str
    argument: str


@dataclass(frozen=True, repr=False)
class Perturbation(Record):
    """A kind of perturbation.

    Attributes:
        name: name of the parametric form, such as "gravity".
        parameter: name of the argument, such as "factor".
        type: type of the argument: "number", "integer", "dimensions" or "file".
        low, high: least and greatest value of the argument.
        takes_range: whether the argument may be "LOW..HIGH", drawn anew for each episode.
        corrupts_datasets: whether datasets can be corrupted by it, too.
        environments: names of the environments to which it applies.
        files: allowed arguments of type "file": the files in the daemon's models folder.
    """

    name: str
    parameter: str
    type: str
    low: float
    high: float
    takes_range: bool
    description: str
    corrupts_datasets: bool
    presets: tuple[Preset, ...]
    environments: tuple[str, ...]
    files: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class WorkerStatus(Record):
    """A process of the daemon. Counts are since the daemon's start, rates over the last second."""

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
    """An open session of any client; `idle_ms` are milliseconds since its last request."""

    environment: str
    perturbations: str
    num_envs: int
    worker: int
    steps: int
    idle_ms: int


@dataclass(frozen=True, repr=False)
class ServerStatus(Record):
    """The daemon's processes and sessions; `sessions` has the first 256 of `session_count`."""

    uptime_ms: int
    workers: tuple[WorkerStatus, ...]
    sessions: tuple[SessionStatus, ...]
    session_count: int


@dataclass(frozen=True, repr=False)
class DatasetInfo(Record):
    """A dataset's file.

    Attributes:
        rows, sha256: number of rows and hash of the file; 0 and "" while it has not been imported.
        behaviour_policy: the policy that recorded the dataset, in the file's words.
        columns_sha256: hash of the rows, whatever else the file holds; "" while it has not been
            imported.
    """

    name: str
    rows: int
    file_bytes: int
    sha256: str
    behaviour_policy: str
    columns_sha256: str


@dataclass(frozen=True, repr=False)
class RecordedPart(Record):
    """Consecutive rows that one behaviour policy recorded with one seed.

    Attributes:
        policy: the behaviour policy in words; policy_sha256 is the hash of its file, "" without one.
        seed: seed of the episodes' starts and of the actions.
    """

    policy: str
    policy_sha256: str
    seed: int
    rows: int


@dataclass(frozen=True, repr=False)
class DatasetProvenance(Record):
    """Where a dataset's rows come from, as its file says; what the file does not say is empty.

    Attributes:
        name: name with version, "HalfCheetah/medium-v0".
        simulator: perturbations of the environment while recording.
        hidden_dimensions: observations that the behaviour policy could not see; 0 in the rows.
        history_length: number of observations that the behaviour policy saw at a time.
        recipe, engine, program, command: how the rows were made, and with what.
    """

    name: str
    environment: str
    simulator: str
    hidden_dimensions: tuple[int, ...]
    history_length: int
    recipe: str
    parts: tuple[RecordedPart, ...]
    engine: str
    program: str
    command: str
    license: str


@dataclass(frozen=True, repr=False)
class SessionInForce(Record):
    """Everything that determines a session's numbers, as the daemon has it in force.

    Attributes:
        perturbations: in the order in which they apply; presets in their parametric form.
        seed: seed of environment 0; environment i has seed + i.
        autoreset_mode: "next_step", "same_step" or "disabled".
        config: all settings of the environment, with defaults for those that were not given.
        experiment_id: sessions with equal ids give equal numbers for equal actions.
        with_infos: whether steps and resets report infos.
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
    """How a dataset is served.

    Attributes:
        fingerprint: hash of the rows, their environment, the corruptions and the transition rule.
        rows: number of rows that the transition rule leaves.
        corruptions: in the order in which they apply; presets in their parametric form.
        hidden_dimensions: indices of observations that a corruption hides, or that the behaviour
            policy could not see: 0 in the rows, whatever noise corrupts the others.
        environment: the environment in which the dataset was recorded; "" if neither the file nor
            its name says.
        seed: seed of the corruptions' noise; 0 where they draw none.
        transition_rule: "stored", or "d4rl" also where the file has no next observations.
        provenance: where the rows come from; its `environment` is "" where the name alone tells it.
    """

    fingerprint: str
    info: DatasetInfo
    rows: int
    observation_size: int
    action_size: int
    corruptions: tuple[NamedArgument, ...]
    hidden_dimensions: tuple[int, ...]
    environment: str
    seed: int
    transition_rule: str
    provenance: DatasetProvenance


@dataclass(frozen=True, repr=False, eq=False)
class DatasetStats(Value, Record):
    """Statistics of a dataset.

    Attributes:
        observation_mean, observation_std: (observation size,) float64, of the rows as served; the
            standard deviation is the population's: 0 where a dimension is hidden, as all its values
            are 0, so add a small number before dividing by it.
        rows, episodes: numbers of rows and of episodes.
        mean_return, std_return, min_return, max_return: undiscounted returns of the file's complete
            episodes.
        min_reward, max_reward: over all rows of the file.
    """

    observation_mean: NDArray[np.float64]
    observation_std: NDArray[np.float64]
    rows: int
    episodes: int
    mean_return: float
    std_return: float
    min_return: float
    max_return: float
    min_reward: float
    max_reward: float


@dataclass(frozen=True, repr=False)
class BenchmarkInfo(Record):
    """A simulator, a dataset, their flaws, and the world in which policies are scored.

    Attributes:
        name: "HalfCheetah/confounding/hidden-high+medium-expert".
        suite: version of the suite, "v0".
        simulator, corruption, world: perturbations of the simulator, of the dataset and of the
            true environment, written as in Client.make: "gravity,obs-noise=0.02"; "" for none.
        dataset: "HalfCheetah/medium-expert"; "" for none.
        algorithms: the only ones that it is defined for; () for all.
        exceptions: algorithms that it is not defined for.
        hyperparameters: those that differ from their defaults.
        paper: the paper's scores by algorithm: (mean, standard deviation) of three seeds.
    """

    name: str
    suite: str
    environment: str
    challenge: str
    simulator: str
    dataset: str
    corruption: str
    world: str
    algorithms: tuple[str, ...]
    exceptions: tuple[str, ...]
    hyperparameters: dict[str, float]
    paper: dict[str, tuple[float, float]]

    def is_defined_for(self, algorithm: str) -> bool:
        """Whether results of an algorithm of that name count for the benchmark."""
        if algorithm in self.exceptions:
            return False
        return not self.algorithms or algorithm in self.algorithms


_KINDS: dict[str, type[Any]] = {
    "BenchmarkInfo": BenchmarkInfo,
    "PresetInfo": Preset,
    "PerturbationInfo": Perturbation,
    "WorkerStatus": WorkerStatus,
    "SessionStatus": SessionStatus,
    "ServerStatusReply": ServerStatus,
    "DatasetInfo": DatasetInfo,
    "RecordedPart": RecordedPart,
    "DatasetProvenance": DatasetProvenance,
    "OpenReply": SessionInForce,
    "OpenDatasetReply": DatasetInForce,
    "NamedArgument": NamedArgument,
}
_READERS: dict[str, Callable[[Any], Any]] = {
    "autoreset_mode": lambda number: AUTORESET_MODES.values_by_number[number].name.lower(),
    "config": lambda text: json.loads(text or "{}"),
    "hyperparameters": lambda entries: {entry.name: entry.value for entry in entries},
    "paper": lambda scores: {score.algorithm: (score.mean, score.std) for score in scores},
}


def read(message: Any) -> Any:
    """The description in a message of b4mrl.proto. InternalError: the message makes no sense."""
    try:
        return _read(message)
    except (KeyError, ValueError, RecursionError) as error:  # of json, for text nested too deeply
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
