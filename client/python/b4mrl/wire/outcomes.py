"""What operations on lanes give: replies as arrays.

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
    """The episodes that ended in a step; m of them.

    Attributes:
        positions: (m,) in the request's lanes.
        observations: (m, observation size), their last ones.
        infos: (m, infos) or None.
        returns, lengths: (m,), undiscounted and in steps.
    """

    positions: NDArray[np.uint32]
    observations: Array
    infos: NDArray[np.float64] | None
    returns: NDArray[np.float64]
    lengths: NDArray[np.uint32]


@dataclass(slots=True)
class Outcome:
    """What a Reset gave; first axes are the request's lanes.

    Attributes:
        lanes: of the request; None for all.
        observations: (n, observation size) in the session's dtype.
        digests: (n,) rolling hash of each lane's trajectory since its last seeded reset.
        infos: (n, infos), or None if the environment has none.
    """

    lanes: Lanes | None
    observations: Array
    digests: NDArray[np.uint64]
    infos: NDArray[np.float64] | None


@dataclass(slots=True)
class StepOutcome(Outcome):
    """What a Step gave.

    Attributes:
        rewards, terminated, truncated, causes: (n,).
        ended: None if no episode ended.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    causes: NDArray[np.uint8]
    ended: Ended | None


@dataclass(frozen=True, slots=True)
class OutcomeReader:
    """Reads replies of one session. InternalError: a reply is not as it should be.

    Attributes:
        dtype: of observations.
        size: of an observation.
        infos: columns of infos; 0 for none.
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
                "unreadable reply: final_lanes names a lane that is not there"
            )
        m = len(positions)
        return Ended(
            positions=positions,
            observations=require(found, "final_observations", self.dtype, (m, self.size)),
            infos=self._infos(found, "final_infos", m),
            returns=require(found, "final_returns", "float64", (m,)),
            lengths=require(found, "final_lengths", "uint32", (m,)),
        )
