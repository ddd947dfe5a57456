"""A session: a batch of environments ("lanes") in a worker of the daemon.

This is the layer under `Environment` and `VectorEnvironment`: requests and replies as arrays, with
every step executed exactly once. Shapes: n lanes, observations (n, observation size), actions
(n, action size). Calls take all lanes, in order (None), or an array of them. A refused request has
changed nothing. After an error whose `executed_unknown` is set, or no answer at all, the lanes of
that request are of no more use.

Thread rule: one thread at a time.
"""

from __future__ import annotations

import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl import arrays, checks, errors, limits
from b4mrl.arrays import Array, require
from b4mrl.connection import FAREWELL_MS, Connection, Delivery
from b4mrl.lane_numbers import LaneNumbers, Lanes
from b4mrl.messages import Request
from b4mrl.spec import EnvironmentSpec

_PICTURES_AT_ONCE = 16  # of one request, so that it is done well within its deadline


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


class Session:
    """What Client opens. Use as a context manager, or close it.

    Args:
        connection: to the worker, with the session's token; owned by the session.
        in_force: the OpenReply.
        deadline_ms: of each request.
    """

    def __init__(
        self, connection: Connection, in_force: Any, spec: EnvironmentSpec, deadline_ms: float
    ) -> None:
        self.in_force = in_force
        self.spec = spec
        self.dtype = np.dtype(np.float64 if in_force.observation_dtype == 2 else np.float32)
        self.deadline_ms = deadline_ms
        self._connection = connection
        self._numbers = LaneNumbers(in_force.num_envs)
        # Numbered requests that have not been received, and those of them for which nobody would
        # wait if Ctrl-C came now.
        self._under_way: dict[int, Lanes | None] = {}
        self._interrupted: set[int] = set()
        # A session that nobody closed is given back when it is collected, or the program ends.
        self._farewell = weakref.finalize(self, connection.farewell, close_request())

    @property
    def num_envs(self) -> int:
        """Lanes; 0 in a session for queries alone."""
        return int(self.in_force.num_envs)

    @property
    def in_flight(self) -> int:
        """Steps that were sent and not received."""
        return len(self._under_way)

    def reset(self, lanes: Lanes | None = None, seeds: NDArray[np.uint64] | None = None) -> Outcome:
        """Starts the next episode, or with `seeds` (n,) the lanes anew at their episode 0."""
        request = Request()
        request.reset.SetInParent()
        columns = {} if seeds is None else {"seeds": seeds}
        delivery = self._call_numbered(request, lanes, columns)
        return self._read_outcome(delivery, lanes)

    def step(self, actions: Array, lanes: Lanes | None = None) -> StepOutcome:
        """One step of every lane: actions (n, action size), float32 or float64."""
        request = Request()
        request.step.SetInParent()
        delivery = self._call_numbered(request, lanes, {"actions": actions})
        return self._read_step(delivery, lanes)

    def send_step(self, actions: Array, lanes: Lanes | None = None) -> int:
        """The first half of step; several may be under way for different lanes."""
        self._settle_interrupted()
        request = Request()
        request.step.SetInParent()
        request_id = self._send_numbered(request, lanes, {"actions": actions})
        self._interrupted.discard(request_id)
        return request_id

    def receive_step(self) -> StepOutcome:
        """The second half: whichever sent step is answered first.

        Its error, if that is what came, has the lanes in `env_ids`.
        """
        if not self._under_way:
            raise errors.FailedPreconditionError("nothing was sent that could be received")
        delivery = self._connection.receive_any(tuple(self._under_way))
        lanes = self._finish(delivery)
        if delivery.error is not None:
            delivery.error.env_ids = np.arange(self.num_envs) if lanes is None else lanes
            raise delivery.error
        return self._read_step(delivery, lanes)

    def snapshot(self, lanes: Lanes | None = None) -> dict[str, Array]:
        """`snapshot` uint8 (n, bytes), exact, and readable parts, float64 (n, size)."""
        self._settle_interrupted()
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
        request = Request()
        request.restore.SetInParent()
        delivery = self._call_numbered(request, lanes, parts)
        return self._read_observations(delivery, self._numbers.count_of(lanes))

    def render(
        self, width: int = 0, height: int = 0, lanes: Lanes | None = None
    ) -> list[NDArray[np.uint8]]:
        """Pictures of lanes as they stand, uint8 (height, width, 3) each; 0: the default size.

        Each is an array of its own.

        It takes tens of milliseconds a lane. FailedPreconditionError: a lane was never reset.
        UnsupportedError: the server cannot draw.
        """
        self._settle_interrupted()
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
        """Gives the session back to the daemon. The daemon's errors are of no use any more."""
        if self._farewell.detach() is None:
            return
        self._connection.abandon_all()
        try:
            deadline_ms = min(self.deadline_ms, FAREWELL_MS)
            self._connection.call(close_request(), bytearray(), deadline_ms)
        except errors.B4mrlError:
            pass  # the lease settles it
        finally:
            self._connection.close()

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send_numbered(
        self, request: Any, lanes: Lanes | None, columns: Mapping[str, Array]
    ) -> int:
        """Sends a Step, Reset or Restore and marks its lanes as under way.

        It counts as interrupted until somebody waits for it: Ctrl-C may come between any two lines.
        """
        if not self._farewell.alive:
            raise errors.FailedPreconditionError("the environment is closed")
        message: dict[str, Array] = {"numbers": self._numbers.begin(lanes)}
        request_id = self._connection.next_id
        self._under_way[request_id] = lanes
        self._interrupted.add(request_id)
        if lanes is not None:
            message["lanes"] = lanes
        try:
            payload = arrays.pack(message | dict(columns), request.arrays)
            self._connection.send(request, payload, self.deadline_ms)
        except errors.B4mrlError:
            self._finish(Delivery(request_id, executed=False))
            raise
        return request_id

    def _call_numbered(
        self, request: Any, lanes: Lanes | None, columns: Mapping[str, Array]
    ) -> Delivery:
        self._settle_interrupted()
        request_id = self._send_numbered(request, lanes, columns)
        delivery = self._connection.receive(request_id)
        self._finish(delivery)
        if delivery.error is not None:
            raise delivery.error
        return delivery

    def _settle_interrupted(self) -> None:
        """Receives what an interrupted call left behind, so that its lanes are free again."""
        while self._interrupted:
            request_id = next(iter(self._interrupted))
            if self._connection.is_in_flight(request_id):
                self._finish(self._connection.receive(request_id))
            else:  # it was never sent, or Ctrl-C came between its answer and here
                executed = False if request_id == self._connection.next_id else None
                self._finish(Delivery(request_id, executed=executed))

    def _finish(self, delivery: Delivery) -> Lanes | None:
        lanes = self._under_way.pop(delivery.request_id)
        self._interrupted.discard(delivery.request_id)
        self._numbers.end(lanes, delivery.executed)
        return lanes

    def _read_observations(self, delivery: Delivery, count: int) -> Array:
        shape = (count, self.spec.observation.size)
        return require(delivery.arrays, "observations", self.dtype, shape)

    def _read_infos(self, found: Mapping[str, Array], name: str, count: int) -> Array | None:
        columns = len(self.spec.info_names)
        if not columns or not self.in_force.with_infos:
            return None
        return require(found, name, "float64", (count, columns))

    def _read_outcome(self, delivery: Delivery, lanes: Lanes | None) -> Outcome:
        count = self._numbers.count_of(lanes)
        return Outcome(
            lanes=lanes,
            observations=self._read_observations(delivery, count),
            digests=require(delivery.arrays, "digests", "uint64", (count,)),
            infos=self._read_infos(delivery.arrays, "infos", count),
        )

    def _read_step(self, delivery: Delivery, lanes: Lanes | None) -> StepOutcome:
        begun = self._read_outcome(delivery, lanes)
        found, count = delivery.arrays, len(begun.observations)
        return StepOutcome(
            lanes=lanes,
            observations=begun.observations,
            digests=begun.digests,
            infos=begun.infos,
            rewards=require(found, "rewards", "float64", (count,)),
            terminated=require(found, "terminated", "uint8", (count,)).astype(np.bool_),
            truncated=require(found, "truncated", "uint8", (count,)).astype(np.bool_),
            causes=require(found, "cause", "uint8", (count,)),
            ended=self._read_ended(found, count) if "final_lanes" in found else None,
        )

    def _read_ended(self, found: Mapping[str, Array], count: int) -> Ended:
        positions = require(found, "final_lanes", "uint32", (None,))
        if np.any(positions >= count):
            raise errors.InternalError(
                "unreadable reply: final_lanes names a lane that is not there"
            )
        m = len(positions)
        shape = (m, self.spec.observation.size)
        return Ended(
            positions=positions,
            observations=require(found, "final_observations", self.dtype, shape),
            infos=self._read_infos(found, "final_infos", m),
            returns=require(found, "final_returns", "float64", (m,)),
            lengths=require(found, "final_lengths", "uint32", (m,)),
        )


def close_request() -> Any:
    request = Request()
    request.close.SetInParent()
    return request
