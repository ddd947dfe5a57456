"""A session: a batch of environments ("lanes") in a worker of the daemon.

This is the layer under `Environment` and `VectorEnvironment`: requests and replies as arrays, with
every step executed exactly once. Shapes: n lanes, observations (n, observation size), actions
(n, action size). Calls take all lanes, in order (None), or an array of them. A refused request has
changed nothing. After an error whose `executed_unknown` is set, or no answer at all, the lanes of
that request are of no more use.

Thread rule: one thread at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors
from b4mrl.wire import arrays, checks, limits
from b4mrl.wire.arrays import Array, require
from b4mrl.wire.connection import Connection
from b4mrl.wire.farewells import Farewell
from b4mrl.wire.lane_numbers import LaneNumbers, Lanes
from b4mrl.wire.messages import Request
from b4mrl.wire.operations import Operations
from b4mrl.wire.outcomes import Outcome, OutcomeReader, StepOutcome

if TYPE_CHECKING:  # kept for whoever holds the session, who read them from the reply to Open
    from b4mrl.descriptions import SessionInForce
    from b4mrl.spec import EnvironmentSpec

T = TypeVar("T")

_PICTURES_AT_ONCE = 16  # of one request, so that it is done well within its deadline


class Session:
    """What Client opens. Use as a context manager, or close it.

    Args:
        connection: to the worker, with the session's token; owned by the session.
        in_force: what the daemon has in force.
        dtype: of observations.
        deadline_ms: of each request.
    """

    def __init__(
        self,
        connection: Connection,
        in_force: SessionInForce,
        spec: EnvironmentSpec,
        dtype: np.dtype[Any],
        deadline_ms: float,
    ) -> None:
        self.in_force = in_force
        self.spec = spec
        self.dtype = dtype
        self.deadline_ms = deadline_ms
        self._connection = connection
        self._numbers = LaneNumbers(in_force.num_envs)
        self._operations = Operations(connection, self._numbers)
        infos = len(spec.info_names) if in_force.with_infos else 0
        self._reader = OutcomeReader(self.dtype, spec.observation.size, infos)
        self._farewell = Farewell(self, connection)

    @property
    def num_envs(self) -> int:
        """Lanes; 0 in a session for queries alone."""
        return self.in_force.num_envs

    def reset(
        self,
        lanes: Lanes | None,
        seeds: NDArray[np.uint64] | None,
        read: Callable[[Outcome], T],
    ) -> T:
        """Starts the next episode, or with `seeds` (n,) the lanes anew at their episode 0.

        `read` of this and other operations: b4mrl.wire.operations.
        """
        columns = {} if seeds is None else {"seeds": seeds}
        return self._call("reset", lanes, columns, lambda *it: read(self._outcome(*it)))

    def step(self, actions: Array, lanes: Lanes | None, read: Callable[[StepOutcome], T]) -> T:
        """One step of every lane: actions (n, action size), float32 or float64."""
        columns = {"actions": actions}
        return self._call("step", lanes, columns, lambda *it: read(self._step_outcome(*it)))

    def send_step(self, actions: Array, lanes: Lanes | None = None) -> None:
        """The first half of step; several may be under way for different lanes."""
        self._refuse_closed()
        self._operations.send_step(lanes, {"actions": actions}, self.deadline_ms)

    def receive_step(self, read: Callable[[StepOutcome], T]) -> T:
        """The second half: whichever sent step is answered first.

        Its error, if that is what came, has the lanes in `env_ids`.
        """
        return self._operations.receive_step(lambda *it: read(self._step_outcome(*it)))

    def snapshot(self, lanes: Lanes | None = None) -> dict[str, Array]:
        """`snapshot` uint8 (n, bytes), exact, and readable parts, float64 (n, size)."""
        self._operations.await_interrupted(self.deadline_ms)
        self._numbers.check_range(lanes)
        request = Request()
        request.snapshot.SetInParent()
        payload = arrays.pack({} if lanes is None else {"lanes": lanes}, request.arrays)
        delivery = self._connection.call(request, payload, self.deadline_ms)
        count = self._numbers.count_of(lanes)
        for name in delivery.arrays:
            dtype = "uint8" if name == "snapshot" else "float64"
            require(delivery.arrays, name, dtype, (count, None))
        return delivery.arrays

    def restore(self, parts: Mapping[str, Array], lanes: Lanes | None = None) -> Array:
        """Writes states: either `snapshot` alone, or readable parts. Returns the observations."""
        count = self._numbers.count_of(lanes)
        return self._call(
            "restore", lanes, parts, lambda found, _: self._reader.observations(found, count)
        )

    def render(
        self, width: int = 0, height: int = 0, lanes: Lanes | None = None
    ) -> list[NDArray[np.uint8]]:
        """Pictures of lanes as they stand, uint8 (height, width, 3) each; 0: the default size.

        Each is an array of its own.

        It takes tens of milliseconds a lane. FailedPreconditionError: a lane was never reset.
        UnsupportedError: the server cannot draw.
        """
        self._operations.await_interrupted(self.deadline_ms)
        width = checks.unsigned("width", width, bits=32) or self.spec.picture_width
        height = checks.unsigned("height", height, bits=32) or self.spec.picture_height
        chosen = np.arange(self.num_envs, dtype=np.uint32) if lanes is None else lanes
        fitting = limits.MAX_PAYLOAD_BYTES // max(3 * width * height, 1)
        at_once = min(max(fitting, 1), _PICTURES_AT_ONCE)
        frames: list[NDArray[np.uint8]] = []
        for first in range(0, len(chosen), at_once):
            part = chosen[first : first + at_once]
            request = Request()
            request.render.width, request.render.height = width, height
            payload = arrays.pack({"lanes": part}, request.arrays)
            delivery = self._connection.call(request, payload, self.deadline_ms)
            shape = (len(part), height, width, 3)
            frames.extend(
                frame.copy() for frame in require(delivery.arrays, "frames", "uint8", shape)
            )
        return frames

    def send_query(
        self, observations: Array, actions: Array, seed: int, draw: int, first_row: int
    ) -> int:
        """Asks for at most limits.MAX_QUERY_ROWS rows of T_sim; receive_query has the answer."""
        request = Request()
        request.query.seed = checks.unsigned("seed", seed)
        request.query.draw = checks.unsigned("draw", draw)
        request.query.first_row = checks.unsigned("first_row", first_row)
        columns = {"observations": observations, "actions": actions}
        payload = arrays.pack(columns, request.arrays)
        return self._connection.send(request, payload, self.deadline_ms)

    def receive_query(self, request_id: int, rows: int) -> tuple[Array, Array, Array, Array]:
        """(next_observations, rewards, terminated, valid) of send_query, `rows` rows each."""
        delivery = self._connection.receive(request_id)
        if delivery.error is not None:
            raise delivery.error
        found = delivery.arrays
        return (
            require(found, "next_observations", self.dtype, (rows, self.spec.observation.size)),
            require(found, "rewards", "float64", (rows,)),
            require(found, "terminated", "uint8", (rows,)).astype(np.bool_),
            require(found, "valid", "uint8", (rows,)).astype(np.bool_),
        )

    def abandon(self, request_id: int) -> None:
        """The answer to a query is not wanted any more."""
        self._connection.abandon(request_id)

    def close(self) -> None:
        """Gives the session back to the daemon. May be called again."""
        self._farewell.take_leave(self.deadline_ms)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _call(
        self,
        kind: str,
        lanes: Lanes | None,
        columns: Mapping[str, Array],
        read: Callable[[Mapping[str, Array], Lanes | None], T],
    ) -> T:
        self._refuse_closed()
        return self._operations.call(kind, lanes, columns, self.deadline_ms, read)

    def _refuse_closed(self) -> None:
        if not self._farewell.is_due:
            raise errors.FailedPreconditionError("the environment is closed")

    def _outcome(self, found: Mapping[str, Array], lanes: Lanes | None) -> Outcome:
        return self._reader.outcome(found, lanes, self._numbers.count_of(lanes))

    def _step_outcome(self, found: Mapping[str, Array], lanes: Lanes | None) -> StepOutcome:
        return self._reader.step(found, lanes, self._numbers.count_of(lanes))
