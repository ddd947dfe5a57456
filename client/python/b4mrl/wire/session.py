"""A session: a batch of environments ("lanes") in a worker of the daemon.

This is the layer under `Environment` and `VectorEnvironment`: requests and replies as arrays, with
every step executed exactly once. Shapes: n lanes, observations (n, observation size), actions
(n, action size). `lanes` is an array of lane numbers, or None for all lanes in order. A refused
request has changed nothing. After an error whose `executed_unknown` is set, it may have been
executed: where no reply came, or a copy of it was refused for the moment, the same call again
settles that; otherwise the lanes of the request cannot be used any more.

Thread rule: one thread at a time.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors
from b4mrl.wire import arrays, checks, limits
from b4mrl.wire.arrays import Array, require
from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery
from b4mrl.wire.farewells import Farewell
from b4mrl.wire.lane_numbers import LaneNumbers, Lanes
from b4mrl.wire.messages import Request
from b4mrl.wire.operations import Operations
from b4mrl.wire.outcomes import LaneStep, Outcome, OutcomeReader, StepOutcome
from b4mrl.wire.pipeline import replies_to

if TYPE_CHECKING:  # kept for whoever holds the session, who read them from the reply to Open
    from b4mrl.descriptions import SessionInForce
    from b4mrl.spec import EnvironmentSpec

T = TypeVar("T")
QueryAnswer = tuple[Array, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]

_PICTURES_AT_ONCE = 16  # pictures of one request, so that it is done well within its deadline


class Session:
    """A session that Client opened. Use as a context manager, or close it.

    Args:
        connection: a connection to the worker, with the session's token; owned by the session.
        in_force: the daemon's reply to Open: settings and perturbations with their values.
        spec: the environment's description under these settings.
        dtype: dtype of observations.
        deadline_ms: time limit of each request, in milliseconds.
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
        self._loss: str | None = None  # what the daemon said when it did not have the session

    @property
    def num_envs(self) -> int:
        """The number of lanes; 0 in a session for queries alone."""
        return self.in_force.num_envs

    @property
    def is_foreign(self) -> bool:
        """Whether this process is a forked child, and its parent had the session open."""
        return self._connection.is_foreign

    @property
    def transport(self) -> str:
        """How messages travel between this process and the worker now.

        "door": through shared memory; "ipc" and "tcp": through sockets; "relay": through the
        gateway's socket. A session that began with "door" goes on over sockets if the daemon ends
        the door.
        """
        return self._connection.transport

    def reset(
        self,
        lanes: Lanes | None,
        seeds: NDArray[np.uint64] | None,
        read: Callable[[Outcome], T],
    ) -> T:
        """Starts the next episode of each lane, or with `seeds` (n,) episode 0 of each seed.

        Returns `read(outcome)`; if Ctrl-C comes before `read` is done, the reset counts as
        interrupted (b4mrl.wire.operations). The same holds for the other operations.
        """
        columns = {} if seeds is None else {"seeds": seeds}
        return self._call("reset", lanes, columns, lambda *it: read(self._outcome(*it)))

    def step(
        self,
        actions: Array,
        lanes: Lanes | None,
        read: Callable[[StepOutcome], T],
        prepare: Callable[[], Any] | None = None,
    ) -> T:
        """One step of every lane: actions (n, action size), float32 or float64.

        `prepare()` is called when the step begins, but not when an interrupted one is repeated:
        what it returns is `prepared` of the outcome, and what it raises keeps the step from being
        sent.
        """
        columns = {"actions": actions}
        return self._call(
            "step", lanes, columns, lambda *it: read(self._step_outcome(*it)), prepare
        )

    def step_lane(self, actions: Array, read: Callable[[LaneStep], T]) -> T:
        """One step of the only lane of a session: actions (1, action size), as in `step`."""
        columns = {"actions": actions}
        return self._call("step", None, columns, lambda it, *_: read(self._reader.lane_step(it)))

    def send_step(
        self,
        actions: Array,
        lanes: Lanes | None,
        read: Callable[[StepOutcome], Any],
        prepare: Callable[[], Any] | None = None,
    ) -> None:
        """The first half of step; several may be under way for different lanes.

        `read` is called with the outcome if it is needed before `receive_step`: by a snapshot of
        the lanes, or if Ctrl-C came before this call was done and another operation follows.
        """
        self._while_open(
            self._operations.send_step,
            lanes,
            {"actions": actions},
            self.deadline_ms,
            lambda *it: read(self._step_outcome(*it)),
            prepare,
        )

    def receive_step(self, read: Callable[[StepOutcome], T]) -> T:
        """The second half of step: `read` of the sent step that is answered first.

        An error has the step's lanes in `env_ids`. A step that got no answer in time is still to be
        received: the next call asks the daemon again.
        """
        result: T = self._while_open(
            self._operations.receive_step,
            self.deadline_ms,
            lambda *it: read(self._step_outcome(*it)),
        )
        return result

    def snapshot(self, lanes: Lanes | None = None) -> dict[str, Array]:
        """The lanes' states: `snapshot` uint8 (n, bytes) and readable parts, float64 (n, size).

        They lie behind the operations of the lanes that are interrupted or under way, whose `read`
        has been called when this returns.
        """
        self._numbers.check_range(lanes)
        request = Request()
        request.snapshot.SetInParent()
        payload = arrays.pack({} if lanes is None else {"lanes": lanes}, request.arrays)
        delivery = self._read_lanes(request, payload, lanes)
        count = self._numbers.count_of(lanes)
        found = delivery.arrays
        for name in found:
            dtype = "uint8" if name == "snapshot" else "float64"
            require(found, name, dtype, (count, None))
        return found

    def restore(
        self, parts: Mapping[str, Array], lanes: Lanes | None, read: Callable[[Array], T]
    ) -> T:
        """Sets the lanes' states, from `snapshot` or readable parts.

        Returns `read(observations)`, as `reset` does.
        """
        count = self._numbers.count_of(lanes)
        try:
            return self._call(
                "restore",
                lanes,
                parts,
                lambda it, *_: read(self._reader.observations(it.arrays, count)),
            )
        except (errors.VersionMismatchError, errors.InvalidArgumentError) as error:
            if "snapshot" in parts and "snapshot" in str(error):
                advice = "remove state['snapshot'] to set its readable parts alone"
                error.args = (f"{error}; {advice}",)
            raise

    def render(
        self, width: int = 0, height: int = 0, lanes: Lanes | None = None
    ) -> list[NDArray[np.uint8]]:
        """Pictures of the lanes' current states, an array uint8 (height, width, 3) for each lane.

        `width` and `height` are pixels; 0 means the environment's default size. A picture takes
        tens of milliseconds. FailedPreconditionError: a lane was never reset. UnsupportedError: the
        daemon cannot draw.
        """
        self._refuse_closed()
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
            delivery = self._read_lanes(request, payload, part)
            shape = (len(part), height, width, 3)
            frames.extend(
                frame.copy() for frame in require(delivery.arrays, "frames", "uint8", shape)
            )
        return frames

    def query(
        self,
        observations: Array,
        actions: Array,
        parts: Sequence[slice],
        seed: int,
        draw: int,
        first_row: int,
        in_flight: int,
    ) -> Generator[tuple[slice, QueryAnswer], None, None]:
        """Each part with its (next_observations, rewards, terminated, valid), in order.

        The first requests are sent at once, before the caller asks for an answer.

        Args:
            parts: rows of one request each, at most limits.MAX_QUERY_ROWS.
            in_flight: number of requests that are sent before the first answer is awaited.
        """
        sent = (
            self._send_query(observations[part], actions[part], seed, draw, first_row + part.start)
            for part in parts
        )
        return self._query_answers(parts, replies_to(self._connection, sent, in_flight))

    def _query_answers(
        self, parts: Sequence[slice], deliveries: Generator[Delivery, None, None]
    ) -> Generator[tuple[slice, QueryAnswer], None, None]:
        # A traceback that somebody keeps would hold `deliveries`, and what they have under way.
        with contextlib.closing(deliveries):
            for part, delivery in zip(parts, deliveries):
                yield part, self._query_answer(delivery.arrays, part.stop - part.start)

    def close(self) -> None:
        """Closes the session at the daemon. May be called again."""
        self._farewell.take_leave(self.deadline_ms)

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send_query(
        self, observations: Array, actions: Array, seed: int, draw: int, first_row: int
    ) -> int:
        request = Request()
        request.query.seed = checks.unsigned("seed", seed)
        request.query.draw = checks.unsigned("draw", draw)
        request.query.first_row = checks.unsigned("first_row", first_row)
        columns = {"observations": observations, "actions": actions}
        payload = arrays.pack(columns, request.arrays)
        return self._connection.send(request, payload, self.deadline_ms)

    def _query_answer(self, found: Mapping[str, Array], rows: int) -> QueryAnswer:
        return (
            require(found, "next_observations", self.dtype, (rows, self.spec.observation.size)),
            require(found, "rewards", "float64", (rows,)),
            require(found, "terminated", "uint8", (rows,)).astype(np.bool_),
            require(found, "valid", "uint8", (rows,)).astype(np.bool_),
        )

    def _read_lanes(self, request: Any, payload: bytearray, lanes: Lanes | None) -> Delivery:
        return self._while_open(
            self._operations.read_lanes, request, payload, lanes, self.deadline_ms
        )

    def _call(
        self,
        kind: str,
        lanes: Lanes | None,
        columns: Mapping[str, Array],
        read: Callable[[Delivery, Lanes | None, Any], T],
        prepare: Callable[[], Any] | None = None,
    ) -> T:
        call = self._operations.call
        return self._while_open(call, kind, lanes, columns, self.deadline_ms, read, prepare)

    def _while_open(self, call: Callable[..., T], *arguments: Any) -> T:
        """`call(*arguments)`. FailedPreconditionError: the environment is closed.

        A signal handler may close it in the middle of the call, which then raises that, too. A
        session that was lost stays so: later calls raise SessionLostError again.
        """
        self._refuse_closed()
        try:
            return call(*arguments)
        except errors.FailedPreconditionError:
            self._refuse_closed()
            raise
        except errors.SessionLostError as error:
            self._loss = str(error)
            raise

    def _refuse_closed(self) -> None:
        if not self._farewell.is_due:
            raise errors.FailedPreconditionError("the environment is closed")
        if self._loss is not None:
            raise errors.SessionLostError(self._loss)

    def _outcome(self, delivery: Delivery, lanes: Lanes | None, _: Any) -> Outcome:
        return self._reader.outcome(delivery.arrays, lanes, self._numbers.count_of(lanes))

    def _step_outcome(self, delivery: Delivery, lanes: Lanes | None, prepared: Any) -> StepOutcome:
        return self._reader.step(delivery, lanes, self._numbers.count_of(lanes), prepared)
