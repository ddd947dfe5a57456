"""Steps, resets and restores of a session: each is executed once, and Ctrl-C loses none.

KeyboardInterrupt, or another exception of a signal handler, may come between any two lines of this
module. An operation whose call was interrupted is kept with its outcome, and so is an operation
whose outcome an error leaves open, as where no reply came within the deadline. The next call about
its lanes first finds out whether the daemon executed it:

- a call of the same kind with the same lanes and arrays returns the kept outcome, so that an
  interrupted call and its repetition have the effect of one call;
- a reset or restore follows the kept operation, whose effect it replaces;
- a step with other actions follows the kept operation, too, and a RuntimeWarning says that the
  caller never got its outcome.

An exception at the very end of a call, after `_end` has let the operation go, comes too late for
this: it loses the outcome on its way to the caller, and a repetition of the call is a new one.

Thread rule: one thread at a time; a second one gets FailedPreconditionError.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors
from b4mrl.wire import limits, plans
from b4mrl.wire.arrays import Array
from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery
from b4mrl.wire.lane_numbers import LaneNumbers, Lanes

T = TypeVar("T")
# From a reply, the lanes of its request, and what `prepare` returned when the operation began.
Read = Callable[[Delivery, "Lanes | None", Any], T]


@dataclass(slots=True)
class _Operation:
    kind: str  # "step", "reset" or "restore"
    lanes: Lanes | None
    numbers: NDArray[np.uint64]
    envelope: bytes
    payload: bytearray
    prepared: Any
    read: Read[Any]  # of the call that began it
    # No call waits for its outcome, or Ctrl-C would end that call, or it got no answer in time.
    is_interrupted: bool = True
    is_sent: bool = False  # by `send_step`, so that `receive_step` returns its outcome


class Operations:
    """The operations of one session.

    Args:
        connection: a connection to the session's worker; not owned.
        numbers: counters of the session's lanes; owned.
    """

    def __init__(self, connection: Connection, numbers: LaneNumbers) -> None:
        self._connection = connection
        self._numbers = numbers
        self._under_way: dict[int, _Operation] = {}  # by the request's id
        self._reading = 0  # the id of the last request of `read_lanes`; 0: no call need await it
        self._inside = 0  # the thread that is in `call`; 0: none

    def call(
        self,
        kind: str,
        lanes: Lanes | None,
        columns: Mapping[str, Array],
        deadline_ms: float,
        read: Read[T],
        prepare: Callable[[], Any] | None = None,
    ) -> T:
        """Executes a Step, Reset or Restore and returns `read(reply, lanes, prepared)`.

        `prepared` is what `prepare()` returned when the operation began, before it was sent. What
        `prepare` raises keeps the operation from beginning; a repetition of an interrupted call
        does not call it. If Ctrl-C comes before `read` is done, the operation counts as
        interrupted, and `read` may have been called already when the call is repeated. It is
        called early, too, where `read_lanes` or another operation needs to know the outcome.
        """
        user = self._require_alone()
        try:
            self._inside = user
            request_id = self._begin(kind, lanes, columns, deadline_ms, prepare, read)
            return self._take(self._connection.await_any((request_id,)), read)
        finally:
            self._inside = 0

    def send_step(
        self,
        lanes: Lanes | None,
        columns: Mapping[str, Array],
        deadline_ms: float,
        read: Read[Any],
        prepare: Callable[[], Any] | None = None,
    ) -> None:
        """The first half of a step; several may be under way for different lanes.

        `read` and `prepare` are as in `call`; `read` is called where the outcome is needed before
        it is received.
        """
        user = self._require_alone()
        try:
            self._inside = user
            request_id = self._begin("step", lanes, columns, deadline_ms, prepare, read)
            operation = self._under_way[request_id]
            operation.is_sent = True
            operation.is_interrupted = False
        finally:
            self._inside = 0

    def receive_step(self, deadline_ms: float, read: Read[T]) -> T:
        """The second half of a step: `read` of the sent step that is answered first.

        An error has the step's lanes in `env_ids`. A step that got no answer in time is still to be
        received: the next call asks the daemon again, for up to `deadline_ms`.
        """
        user = self._require_alone()
        try:
            self._inside = user
            sent = {each: it for each, it in self._under_way.items() if it.is_sent}
            if not sent:
                raise errors.FailedPreconditionError(
                    "there is no sent step to receive; call send first"
                )
            for request_id, operation in sent.items():
                if operation.is_interrupted:
                    self._connection.ask_again(request_id, deadline_ms)
                    operation.is_interrupted = False
            delivery = self._connection.await_any(sent)
            if delivery.error is not None:
                lanes = sent[delivery.request_id].lanes
                delivery.error.env_ids = np.arange(self._numbers.count) if lanes is None else lanes
            return self._take(delivery, read)
        finally:
            self._inside = 0

    def read_lanes(
        self, request: Any, payload: bytearray, lanes: Lanes | None, deadline_ms: float
    ) -> Delivery:
        """Connection.call of a request that changes nothing, but takes `lanes` for a while.

        It sees what the interrupted operations have done, and the sent steps of `lanes`. Their
        `read` has been called when it returns, so whoever keeps what the latest outcome says about
        a lane knows it of what was read here; the outcomes are kept for their callers. If Ctrl-C
        ends its wait, the next call of this session waits in its place, as the daemon would refuse
        a lane that is being read. Raises the error of an operation whose outcome is unknown.
        """
        user = self._require_alone()
        try:
            self._inside = user
            self._await_operations(lanes, deadline_ms)
            if len(self._under_way) >= limits.MAX_REQUESTS_IN_FLIGHT:
                self._connection.await_any(self._under_way)  # so that the daemon takes one more
            self._reading = self._connection.next_id
            sent = self._connection.send(request, payload, deadline_ms, is_awaited=True)
            return self._connection.reply_to(sent)
        finally:
            self._inside = 0

    def _await_operations(self, lanes: Lanes | None, deadline_ms: float) -> None:
        """Waits until the interrupted operations, and the sent ones of `lanes`, are executed.

        Reads their outcomes, and keeps them.
        """
        self._await_reading()
        self._drop_unsent()
        for request_id, operation in list(self._under_way.items()):
            if not operation.is_interrupted and not _overlap(lanes, operation.lanes):
                continue
            delivery = self._settle(request_id, deadline_ms)
            if delivery.error is None:
                operation.read(delivery, operation.lanes, operation.prepared)

    def _await_reading(self) -> None:
        """Waits until the daemon has done an interrupted request of `read_lanes`.

        Comes before the next request is sent, which would have the id of one that never was.
        """
        if self._connection.is_in_flight(self._reading):
            self._connection.receive(self._reading)
        self._reading = 0

    def _require_alone(self) -> int:
        user = threading.get_ident()
        if not self._inside or self._connection.is_inherited:
            return user  # a forked child has none of its parent's other threads
        if self._inside == user:
            raise errors.FailedPreconditionError(
                "a call of this environment is under way in this thread; allowed: one at a time, "
                "so a signal handler uses the environment once the call has returned, or closes it"
            )
        raise errors.another_thread()

    def _settle(self, request_id: int, deadline_ms: float) -> Delivery:
        """The outcome of an operation. Raises the error if it is still unknown."""
        if self._under_way[request_id].is_interrupted:
            self._connection.ask_again(request_id, deadline_ms)
        delivery = self._connection.await_any((request_id,))
        if delivery.error is not None and delivery.unsettled is not None:
            self._under_way[request_id].is_interrupted = True
            raise delivery.error
        return delivery

    def _interrupted(self) -> list[int]:
        return [each for each, operation in self._under_way.items() if operation.is_interrupted]

    def _drop_unsent(self) -> None:
        """Frees the lanes of operations that Ctrl-C kept from being sent.

        Nothing else would: the next request may get such an operation's id and take its place.
        """
        for request_id in self._interrupted():
            if not self._connection.is_in_flight(request_id):
                self._end(request_id, False)

    def _begin(
        self,
        kind: str,
        lanes: Lanes | None,
        columns: Mapping[str, Array],
        deadline_ms: float,
        prepare: Callable[[], Any] | None,
        read: Read[Any],
    ) -> int:
        """Sends an operation, or finds the interrupted one that it repeats; returns the request id.

        The operation counts as interrupted until _take reads its outcome or send_step returns.
        """
        self._await_reading()
        if self._under_way:
            self._drop_unsent()
            for request_id in self._interrupted():
                if self._is_repeated(request_id, kind, lanes, columns):
                    self._connection.ask_again(request_id, deadline_ms)
                    return request_id
            self._pass_over(kind, lanes, deadline_ms)
        prepared = None if prepare is None else prepare()
        numbers = self._numbers.next_of(lanes)
        packed = _pack(kind, lanes, numbers, columns)
        operation = _Operation(kind, lanes, numbers, *packed, prepared, read)
        request_id = self._connection.next_id
        self._under_way[request_id] = operation
        self._numbers.begin(lanes)
        try:
            self._connection.send(operation.envelope, operation.payload, deadline_ms)
        except errors.B4mrlError:
            self._end(request_id, False)
            raise
        return request_id

    def _is_repeated(
        self, request_id: int, kind: str, lanes: Lanes | None, columns: Mapping[str, Array]
    ) -> bool:
        operation = self._under_way[request_id]
        if operation.kind != kind or self._numbers.count_of(lanes) != len(operation.numbers):
            return False
        again = _pack(kind, lanes, operation.numbers, columns)
        return again == (operation.envelope, operation.payload)

    def _pass_over(self, kind: str, lanes: Lanes | None, deadline_ms: float) -> None:
        """Ends the interrupted operations of `lanes`, before another operation of `kind`.

        Their outcomes are read, though no caller gets them: whoever keeps what the latest outcome
        says about a lane, such as the end of its episode, is not to miss one.
        """
        for request_id in self._interrupted():
            operation = self._under_way[request_id]
            if not _overlap(lanes, operation.lanes):
                continue
            delivery = self._settle(request_id, deadline_ms)
            if delivery.error is not None:
                self._end(delivery.request_id, delivery.executed)
            else:
                self._take(delivery, operation.read)
            if kind == "step" and delivery.executed:
                errors.warn(
                    f"the interrupted {operation.kind} (operation {operation.numbers[0]} of its "
                    "environment) was executed and its outcome is dropped; to get the outcome, "
                    "repeat an interrupted call with the same arguments first"
                )

    def _take(self, delivery: Delivery, read: Read[T]) -> T:
        operation = self._under_way[delivery.request_id]
        if delivery.error is not None:
            operation.is_interrupted = True
            if delivery.unsettled is None:
                self._end(delivery.request_id, delivery.executed)
            raise delivery.error
        try:
            result = read(delivery, operation.lanes, operation.prepared)
        except errors.B4mrlError:
            self._end(delivery.request_id, delivery.executed)
            raise
        self._end(delivery.request_id, delivery.executed)
        return result

    def _end(self, request_id: int, executed: bool | None) -> None:
        operation = self._under_way[request_id]
        self._numbers.end(operation.lanes, operation.numbers, executed)
        del self._under_way[request_id]
        self._connection.abandon(request_id)


def _pack(
    kind: str, lanes: Lanes | None, numbers: NDArray[np.uint64], columns: Mapping[str, Array]
) -> tuple[bytes, bytearray]:
    """The envelope and the payload of an operation."""
    if lanes is None:
        return plans.pack(kind, {"numbers": numbers, **columns})
    return plans.pack(kind, {"numbers": numbers, "lanes": lanes, **columns})


def _overlap(one: Lanes | None, other: Lanes | None) -> bool:
    return one is None or other is None or len(np.intersect1d(one, other)) > 0
