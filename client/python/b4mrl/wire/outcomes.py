"""Outcomes of operations on lanes, read from the arrays of replies.

Shapes: n lanes of a request, observations (n, observation size).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors
from b4mrl.wire.arrays import Array, require
from b4mrl.wire.lane_numbers import Lanes


@dataclass(slots=True)
class Ended:
    """The m episodes that ended in a step.

    Attributes:
        positions: (m,) positions of the episodes' lanes among the request's lanes.
        observations: (m, observation size), the last observation of each episode.
        infos: (m, infos), the last infos of each episode, or None if the environment has none.
        returns: (m,) undiscounted returns.
        lengths: (m,) numbers of steps.
    """

    positions: NDArray[np.uint32]
    observations: Array
    infos: NDArray[np.float64] | None
    returns: NDArray[np.float64]
    lengths: NDArray[np.uint32]


@dataclass(slots=True)
class Outcome:
    """The outcome of a Reset; first axes are the request's lanes.

    Attributes:
        lanes: the request's lanes; None for all lanes.
        observations: (n, observation size) in the session's dtype.
        digests: (n,) rolling hashes of each lane's trajectory since its last seeded reset.
        infos: (n, infos), or None if the environment has none.
    """

    lanes: Lanes | None
    observations: Array
    digests: NDArray[np.uint64]
    infos: NDArray[np.float64] | None


@dataclass(slots=True)
class StepOutcome(Outcome):
    """The outcome of a Step; first axes are the request's lanes.

    Attributes:
        rewards, terminated, truncated: (n,) as in Gymnasium.
        causes: (n,) numbers of Cause in b4mrl.proto; 0 if the episode goes on.
        ended: the episodes that ended in this step; None if none did.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    causes: NDArray[np.uint8]
    ended: Ended | None


@dataclass(frozen=True, slots=True)
class OutcomeReader:
    """Reads replies of one session. InternalError: a reply is malformed.

    Attributes:
        dtype: dtype of observations.
        size: number of dimensions of an observation.
        infos: number of columns of infos; 0 if the environment has none.
    """

    dtype: np.dtype[Any]
    size: int
    infos: int

    def observations(self, found: Mapping[str, Array], count: int) -> Array:
        return require(found, "observations", self.dtype, (count, self.size))

    def outcome(self, found: Mapping[str, Array], lanes: Lanes | None, count: int) -> Outcome:
        return Outcome(
            lanes=lanes,
            observations=self.observations(found, count),
            digests=require(found, "digests", "uint64", (count,)),
            infos=self._infos(found, "infos", count),
        )

    def step(self, found: Mapping[str, Array], lanes: Lanes | None, count: int) -> StepOutcome:
        return StepOutcome(
            lanes=lanes,
            observations=self.observations(found, count),
            digests=require(found, "digests", "uint64", (count,)),
            infos=self._infos(found, "infos", count),
            rewards=require(found, "rewards", "float64", (count,)),
            terminated=require(found, "terminated", "uint8", (count,)).astype(np.bool_),
            truncated=require(found, "truncated", "uint8", (count,)).astype(np.bool_),
            causes=require(found, "cause", "uint8", (count,)),
            ended=self._ended(found, count) if "final_lanes" in found else None,
        )

    def _infos(self, found: Mapping[str, Array], name: str, count: int) -> Array | None:
        return require(found, name, "float64", (count, self.infos)) if self.infos else None

    def _ended(self, found: Mapping[str, Array], count: int) -> Ended:
        positions = require(found, "final_lanes", "uint32", (None,))
        if np.any(positions >= count):
            raise errors.InternalError(
                f"unreadable reply: final_lanes has a position outside 0..{count - 1}"
            )
        m = len(positions)
        return Ended(
            positions=positions,
            observations=require(found, "final_observations", self.dtype, (m, self.size)),
            infos=self._infos(found, "final_infos", m),
            returns=require(found, "final_returns", "float64", (m,)),
            lengths=require(found, "final_lengths", "uint32", (m,)),
        )
