"""Queries of a simulator with any number of rows, split into requests."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from b4mrl.errors import InvalidArgumentError
from b4mrl.wire import limits
from b4mrl.wire.arrays import Array
from b4mrl.wire.session import Session

# Several requests keep every thread of a worker busy while one reply is copied out. Small requests
# are done within their deadline even if a row takes milliseconds.
_REQUESTS_IN_FLIGHT = 6
_ROWS_AT_ONCE = min(1024, limits.MAX_QUERY_ROWS)

Answer = tuple[Array, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]


@dataclass(frozen=True)
class Rows:
    """Observations and actions, (rows, ...) each, of one dtype: float32 or float64."""

    observations: Array
    actions: Array

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.observations.dtype

    @classmethod
    def of(cls, observations: ArrayLike, actions: ArrayLike) -> Rows:
        """Reads a caller's arrays. InvalidArgumentError: their numbers of rows differ."""
        given = np.asarray(observations)
        dtype = np.float64 if given.dtype == np.float64 else np.float32
        states, controls = given.astype(dtype, copy=False), np.asarray(actions, dtype)
        if states.ndim < 2 or controls.ndim < 2 or len(states) != len(controls):
            raise InvalidArgumentError(
                f"observations have shape {states.shape} and actions {controls.shape}, "
                "allowed: (rows, ...) with equally many rows"
            )
        return cls(states, controls)

    def flat(self, observation_size: int, action_size: int) -> Rows:
        """The same numbers as (rows, size). InvalidArgumentError: a row has another size."""
        rows = len(self.observations)
        sizes = self.observations.size, self.actions.size
        if sizes != (rows * observation_size, rows * action_size):
            raise InvalidArgumentError(
                f"observations have shape {self.observations.shape} and actions "
                f"{self.actions.shape}, allowed: {observation_size} and {action_size} values a row"
            )
        return Rows(
            self.observations.reshape(rows, observation_size),
            self.actions.reshape(rows, action_size),
        )


def run(session: Session, rows: Rows, seed: int, draw: int, first_row: int) -> Answer:
    """Sends all rows to `session`, which has the dtype of `rows`; returns as Client.query does."""
    flat = rows.flat(session.spec.observation.size, session.spec.action.size)
    count = len(flat.observations)
    at_once = _rows_at_once(flat)
    next_observations = np.empty((count, session.spec.observation.size), session.dtype)
    rewards = np.empty(count)
    terminated, valid = np.empty(count, np.bool_), np.empty(count, np.bool_)
    parts = [slice(i, min(i + at_once, count)) for i in range(0, count, at_once)]
    for part, answer in session.query(
        flat.observations, flat.actions, parts, seed, draw, first_row, _REQUESTS_IN_FLIGHT
    ):
        next_observations[part], rewards[part], terminated[part], valid[part] = answer
    return next_observations.reshape(rows.observations.shape), rewards, terminated, valid


def _rows_at_once(rows: Rows) -> int:
    """The largest number of rows of a request that fits the request and its reply."""
    (_, observation), (_, action) = rows.observations.shape, rows.actions.shape
    itemsize = rows.dtype.itemsize
    # Beside the observation, a request has the action, a reply the reward and two flags.
    row_bytes = itemsize * observation + max(itemsize * action, 8 + 2)
    padding = limits.MAX_ARRAYS_PER_MESSAGE * limits.ARRAY_ALIGNMENT
    fitting: int = (limits.MAX_PAYLOAD_BYTES - padding) // row_bytes
    return min(_ROWS_AT_ONCE, fitting)
