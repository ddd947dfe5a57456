"""Outcomes of operations on lanes, read from the arrays of replies.

Shapes: n lanes of a request, observations (n, observation size).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors
from b4mrl.wire.arrays import Array, require
from b4mrl.wire.deliveries import Delivery
from b4mrl.wire.lane_numbers import Lanes
from b4mrl.wire.tables import Table

_STEP_ARRAYS = (
    "observations",
    "digests",
    "rewards",
    "terminated",
    "truncated",
    "cause",
    "infos",
)
_FLOAT64, _UINT64 = struct.Struct("<d"), struct.Struct("<Q")


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
        prepared: what the caller's `prepare` returned when the step began; None without one.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    causes: NDArray[np.uint8]
    ended: Ended | None
    prepared: Any


class LaneStep(NamedTuple):
    """The outcome of a Step of the only lane of a session; as in StepOutcome, but numbers.

    `observation` is flat; `infos` has the lane's infos, or is None if the environment has none.
    """

    observation: Array
    infos: tuple[float, ...] | None
    reward: float
    terminated: bool
    truncated: bool
    cause: int
    digest: int


class OutcomeReader:
    """Reads replies of one session. InternalError: a reply is malformed.

    Replies to Step repeat the table of their arrays (b4mrl.wire.tables); the reader checks a table
    once, and keeps the latest one that it has checked.

    Args:
        dtype: dtype of observations.
        size: number of dimensions of an observation.
        infos: number of columns of infos; 0 if the environment has none.

    Thread rule: one thread at a time.
    """

    def __init__(self, dtype: np.dtype[Any], size: int, infos: int) -> None:
        self._dtype = dtype
        self._size = size
        self._infos_count = infos
        self._infos_row = struct.Struct(f"<{infos}d")
        self._checked: tuple[Table | None, int] = None, 0  # and the number of the reply's lanes
        self._offsets: tuple[int, ...] = ()  # of the arrays of a checked step, as in _STEP_ARRAYS

    def observations(self, found: Mapping[str, Array], count: int) -> Array:
        return require(found, "observations", self._dtype, (count, self._size))

    def outcome(self, found: Mapping[str, Array], lanes: Lanes | None, count: int) -> Outcome:
        return Outcome(
            lanes=lanes,
            observations=self.observations(found, count),
            digests=require(found, "digests", "uint64", (count,)),
            infos=self._infos(found, "infos", count),
        )

    def step(
        self, delivery: Delivery, lanes: Lanes | None, count: int, prepared: Any = None
    ) -> StepOutcome:
        self._check_step(delivery, count)
        found = delivery.arrays
        return StepOutcome(
            lanes=lanes,
            observations=found["observations"],
            digests=found["digests"],
            infos=found["infos"] if self._infos_count else None,
            rewards=found["rewards"],
            terminated=found["terminated"].astype(np.bool_),
            truncated=found["truncated"].astype(np.bool_),
            causes=found["cause"],
            ended=self._ended(found, count) if "final_lanes" in found else None,
            prepared=prepared,
        )

    def lane_step(self, delivery: Delivery) -> LaneStep:
        self._check_step(delivery, 1)
        payload = delivery.payload
        assert payload is not None  # _check_step found the arrays
        observations, digests, rewards, terminated, truncated, causes, infos = self._offsets
        return LaneStep(
            np.ndarray((self._size,), self._dtype, payload, observations),
            self._infos_row.unpack_from(payload, infos) if self._infos_count else None,
            _FLOAT64.unpack_from(payload, rewards)[0],
            payload[terminated] != 0,
            payload[truncated] != 0,
            payload[causes],
            _UINT64.unpack_from(payload, digests)[0],
        )

    def _check_step(self, delivery: Delivery, count: int) -> None:
        """Checks dtypes and shapes of the arrays that every reply to Step has."""
        table, checked = delivery.table, self._checked
        if table is not None and table is checked[0] and count == checked[1]:
            return
        found = delivery.arrays
        self.outcome(found, None, count)
        require(found, "rewards", "float64", (count,))
        for name in ("terminated", "truncated", "cause"):
            require(found, name, "uint8", (count,))
        assert table is not None  # it has these arrays
        names = _STEP_ARRAYS if self._infos_count else _STEP_ARRAYS[:-1]
        offsets = tuple(table.places[name][2] for name in names)
        self._offsets = offsets if self._infos_count else (*offsets, 0)
        self._checked = table, count

    def _infos(self, found: Mapping[str, Array], name: str, count: int) -> Array | None:
        columns = self._infos_count
        return require(found, name, "float64", (count, columns)) if columns else None

    def _ended(self, found: Mapping[str, Array], count: int) -> Ended:
        positions = require(found, "final_lanes", "uint32", (None,))
        if np.any(positions >= count):
            raise errors.InternalError(
                f"unreadable reply: final_lanes has a position outside 0..{count - 1}"
            )
        m = len(positions)
        return Ended(
            positions=positions,
            observations=require(found, "final_observations", self._dtype, (m, self._size)),
            infos=self._infos(found, "final_infos", m),
            returns=require(found, "final_returns", "float64", (m,)),
            lengths=require(found, "final_lengths", "uint32", (m,)),
        )
