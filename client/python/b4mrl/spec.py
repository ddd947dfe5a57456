"""The daemon's description of an environment: its spaces, reward, limits and infos."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, DTypeLike, NDArray

from b4mrl.config import MOST_STEPS
from b4mrl.display import Shown, table
from b4mrl.errors import InternalError
from b4mrl.infos import check_info_names
from b4mrl.values import Value
from b4mrl.wire import checks, limits


@dataclass(frozen=True, repr=False, eq=False)
class SpaceSpec(Value, Shown):
    """A box of observations or actions.

    Attributes:
        shape: extents of an array in the space; their product is the number of dimensions.
        names, units: name and unit of every dimension in row-major order; a unit may be "".
        low, high: (dimensions,) float64, bounds of every dimension, possibly infinite.
    """

    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    low: NDArray[np.float64]
    high: NDArray[np.float64]

    @property
    def size(self) -> int:
        return len(self.names)

    def _facts(self) -> Mapping[str, Any]:
        return {"shape": self.shape, "names": reprlib.repr(self.names)}

    def _repr_html_(self) -> str:
        rows = zip(range(self.size), self.names, self.units, self.low, self.high)
        return table(("", "name", "unit", "low", "high"), rows)

    def box(self, dtype: DTypeLike) -> spaces.Box:
        """This space as Gymnasium's; bounds are rounded to `dtype`, as in Gymnasium's tasks."""
        kind = np.dtype(dtype)
        low, high = (bound.astype(kind).reshape(self.shape) for bound in (self.low, self.high))
        return spaces.Box(low, high, dtype=kind.type)


@dataclass(frozen=True)
class DimensionBounds:
    """Bounds of one dimension of an observation, outside which the episode ends.

    NaN and infinite numbers are outside.

    Attributes:
        dimension: index into the flattened observation.
        low, high: the bounds; a bound that is infinite does not limit finite numbers.
        inclusive: whether low and high themselves are inside.
    """

    dimension: int
    low: float
    high: float
    inclusive: bool


@dataclass(frozen=True, repr=False)
class EnvironmentSpec(Shown):
    """The specification of one environment under one configuration.

    Attributes:
        reward: the reward's formula, in words.
        max_episode_steps: number of steps after which an episode is truncated; 0 for no limit.
        step_seconds: simulated seconds of one step.
        reference_min, reference_max: returns that D4RL's normalised score maps to 0 and 100; None
            for environments that D4RL lacks.
        info_names: names of a step's infos (proto/PROTOCOL.md, section 8).
        reset_info_names: those of `info_names` that a reset reports, too.
        picture_width, picture_height: default size of pictures, in pixels.
        termination: bounds outside which a predicted observation ends the episode: the task's own,
            but MOPO's one-sided ones for the default `healthy_state_range` of the Hopper, and
            MOPO's for the Humanoid, whose ends are inside. None: the end of an episode does not
            follow from the observation.
    """

    name: str
    observation: SpaceSpec
    action: SpaceSpec
    reward: str
    max_episode_steps: int
    step_seconds: float
    reference_min: float | None
    reference_max: float | None
    info_names: tuple[str, ...]
    reset_info_names: tuple[str, ...]
    picture_width: int
    picture_height: int
    termination: tuple[DimensionBounds, ...] | None

    def _facts(self) -> Mapping[str, Any]:
        return {
            "name": self.name,
            "observation": self.observation.shape,
            "action": self.action.shape,
            "reward": self.reward,
            "max_episode_steps": self.max_episode_steps,
            "step_seconds": self.step_seconds,
        }

    @overload
    def normalised_score(self, episode_return: float) -> float | None: ...

    @overload
    def normalised_score(
        self, episode_return: NDArray[Any] | Sequence[float]
    ) -> NDArray[np.float64] | None: ...

    def normalised_score(self, episode_return: ArrayLike) -> float | NDArray[np.float64] | None:
        """D4RL's 100 (return - reference_min) / (reference_max - reference_min); None without.

        An array of returns gives an array of scores of the same shape. InvalidArgumentError:
        `episode_return` is neither a number nor an array of numbers.
        """
        given = checks.numbers("episode_return", episode_return)
        if self.reference_min is None or self.reference_max is None:
            return None
        span = self.reference_max - self.reference_min
        scores: NDArray[np.float64] = 100.0 * (given - self.reference_min) / span
        return float(scores) if given.ndim == 0 else scores


def spec_of(info: Any) -> EnvironmentSpec:
    """Reads an EnvironmentInfo of the wire. InternalError: its sizes or names are not sane."""
    if not 0 < info.step_seconds < math.inf:
        raise InternalError(f"the server describes steps of {info.step_seconds} seconds")
    check_info_names(info.info_names)
    return EnvironmentSpec(
        name=info.name,
        observation=_space_of(info.observation, limits.MAX_OBSERVATION_DIMENSIONS),
        action=_space_of(info.action, limits.MAX_ACTION_DIMENSIONS),
        reward=info.reward,
        max_episode_steps=0 if info.max_episode_steps == MOST_STEPS else info.max_episode_steps,
        step_seconds=info.step_seconds,
        reference_min=info.reference_min if info.HasField("reference_min") else None,
        reference_max=info.reference_max if info.HasField("reference_max") else None,
        info_names=tuple(info.info_names),
        reset_info_names=tuple(info.reset_info_names),
        picture_width=info.picture_width,
        picture_height=info.picture_height,
        termination=_termination_of(info) if info.HasField("termination") else None,
    )


def _termination_of(info: Any) -> tuple[DimensionBounds, ...]:
    return tuple(
        DimensionBounds(bounds.dimension, bounds.low, bounds.high, bounds.inclusive)
        for bounds in info.termination.bounds
    )


def _space_of(space: Any, most_dimensions: int) -> SpaceSpec:
    dimensions = space.dimensions
    shape = tuple(space.shape)
    if not 0 < len(dimensions) <= most_dimensions or np.prod(shape) != len(dimensions):
        raise InternalError(f"the server describes {len(dimensions)} dimensions of shape {shape}")
    return SpaceSpec(
        shape=shape,
        names=tuple(dimension.name for dimension in dimensions),
        units=tuple(dimension.unit for dimension in dimensions),
        low=np.array([dimension.low for dimension in dimensions]),
        high=np.array([dimension.high for dimension in dimensions]),
    )
