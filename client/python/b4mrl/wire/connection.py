"""One connection to one server process: requests out, replies in, whatever happens to the server.

A request carries an id, and stays here, payload included, until its reply has come or its deadline
has passed. It is sent again, unchanged but for the deadline,

- after a reconnection: the process behind it may be a replacement, and what the old one held is
  gone. Once, it then has an eighth of its deadline again, for the caller may have been busy
  elsewhere all the while;
- when an eighth of its deadline has passed without any reply to anything.

The server executes a numbered step once, however often it arrives; replies that come twice, or
after their request was given up, are dropped.

Thread rule: one thread at a time. A connection does not survive a fork: the child's calls are
refused.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import os
import threading
import time
import weakref
from collections.abc import Iterable
from typing import Any

import zmq
from google.protobuf.message import DecodeError

from b4mrl import errors
from b4mrl.wire import limits, sockets
from b4mrl.wire.deliveries import Delivery, Pending, read_reply
from b4mrl.wire.messages import Reply, Request

# Of a request, unless its caller has another. A machine that is busy with other things must not end
# what runs for hours.
DEADLINE_MS = 120_000
FAREWELL_MS = 500  # for a last request, when everything may be gone already

_all: weakref.WeakSet[Connection] = weakref.WeakSet()


class Connection:
    """Requests to, and replies from, the process that listens on `address`.

    Args:
        address: "tcp://HOST:PORT" or "ipc://PATH". The first request waits for the connection.
        token: the session's 16 bytes, or b"" where no session is meant.

    Raises:
        InvalidArgumentError: `address` is none.
        UnavailableError: the system has no more sockets.

    Attributes:
        address: as given.
    """

    def __init__(self, address: str, token: bytes = b"") -> None:
        self.address = address
        self._user = 0  # the thread that sent the last request
        self._token = token
        self._next_id = 1
        self._handshakes = 0
        self._last_reply = 0.0
        self._pending: dict[int, Pending] = {}
        self._arrived: dict[int, Delivery] = {}
        self._link = sockets.open_link(address)
        self._socket = self._link.socket
        self._close_link = weakref.finalize(self, self._link.close)  # also when it is collected
        self._close_link.atexit = False  # close_all does it
        _all.add(self)

    @property
    def is_usable(self) -> bool:
        """Whether it was neither closed nor made before a fork."""
        return self._close_link.alive and self._link.process_id == os.getpid()

    @property
    def is_free(self) -> bool:
        """Whether it is not another thread's, which may be in the middle of a call."""
        others = {thread.ident for thread in threading.enumerate()} - {threading.get_ident()}
        return self._user not in others

    @property
    def is_foreign(self) -> bool:
        """Whether it was made before a fork, in the parent, and not closed there."""
        return self._close_link.alive and self._link.process_id != os.getpid()

    def close(self, linger_ms: int = 0) -> None:
        """Closes the socket; requests that are not answered yet are given up.

        What was sent may leave for up to `linger_ms`, in the background.
        """
        self._pending.clear()
        if self._close_link.detach() is not None:
            self._link.close(linger_ms)

    def farewell(self, request: Any) -> None:
        """Sends a last request, whose reply nobody waits for, and closes."""
        if self.is_usable:
            self.abandon_all()  # as many as may be in flight must not keep the last one back
            with contextlib.suppress(errors.B4mrlError):
                self.send(request, bytearray(), FAREWELL_MS)
        self.close(linger_ms=FAREWELL_MS)

    @property
    def handshakes(self) -> int:
        """How often the connection was made; above 1 after the server was replaced."""
        self._handshakes += self._link.take_handshakes()
        return self._handshakes

    def await_handshake(self, timeout_ms: float) -> bool:
        """Waits until the connection is made for the first time; False if it is not by then."""
        finish = time.monotonic() + timeout_ms / 1000
        while self.handshakes == 0:
            wait_ms = math.ceil((finish - time.monotonic()) * 1000)
            if wait_ms <= 0:
                return False
            self._link.monitor.poll(wait_ms)
        return True

    @property
    def next_id(self) -> int:
        """What the next send returns."""
        return self._next_id

    def is_in_flight(self, request_id: int) -> bool:
        """Whether receive has, or will have, something for a request."""
        return request_id in self._pending or request_id in self._arrived

    def send(self, request: Any, payload: bytearray, deadline_ms: float) -> int:
        """Sends a request and returns its id.

        Args:
            request: a Request with its payload and its table of arrays; version, token, id and
                deadline are filled in here.
            payload: the arrays' bytes; empty for none. It is kept, so nobody may change it.

        Raises:
            LimitExceededError: too many requests are in flight, or the envelope is too long.
            UnavailableError: the queue towards the server is full.
            FailedPreconditionError: the connection was closed, or made before a fork.
        """
        self._user = threading.get_ident()
        if not self._close_link.alive:
            raise errors.FailedPreconditionError("closed; make a new one")
        if self.is_foreign:
            raise errors.FailedPreconditionError(
                "made in another process; connect again in this one (after a fork)"
            )
        if len(self._pending) + len(self._arrived) >= limits.MAX_REQUESTS_IN_FLIGHT:
            raise errors.LimitExceededError(
                f"allowed: at most {limits.MAX_REQUESTS_IN_FLIGHT} requests in flight"
            )
        envelope = request.SerializeToString()
        if len(envelope) + 64 > limits.MAX_ENVELOPE_BYTES:
            raise errors.LimitExceededError(
                f"the request has {len(envelope)} bytes beside its arrays, "
                f"allowed: at most {limits.MAX_ENVELOPE_BYTES}"
            )
        request_id = self._next_id
        pending = Pending(envelope, payload)
        pending.set_deadline(deadline_ms)
        # Kept before it is sent: were Ctrl-C to come in between, it must not be forgotten.
        self._next_id += 1
        self._pending[request_id] = pending
        if not self._transmit(request_id, pending):
            del self._pending[request_id]
            raise errors.UnavailableError("the queue towards the server is full")
        return request_id

    def receive(self, request_id: int) -> Delivery:
        """Waits for what becomes of a request, at most until its deadline."""
        return self.receive_any((request_id,))

    def receive_any(self, request_ids: Iterable[int]) -> Delivery:
        """Waits for whichever of the requests is settled first.

        FailedPreconditionError: none of them is in flight.
        """
        delivery = self.await_any(request_ids)
        del self._arrived[delivery.request_id]
        return delivery

    def await_any(self, request_ids: Iterable[int]) -> Delivery:
        """What receive_any returns, and would return again, until it is abandoned."""
        while True:
            for request_id in request_ids:
                if request_id in self._arrived:
                    return self._arrived[request_id]
            if not any(request_id in self._pending for request_id in request_ids):
                raise errors.FailedPreconditionError("no such request is in flight")
            self._pump()

    def call(self, request: Any, payload: bytearray, deadline_ms: float) -> Delivery:
        """Sends a request and waits for its reply. Raises what the server answers."""
        request_id = self.send(request, payload, deadline_ms)
        try:
            delivery = self.receive(request_id)
        finally:
            self.abandon(request_id)  # after Ctrl-C nobody else would receive it
        if delivery.error is not None:
            raise delivery.error
        return delivery

    def ask_again(self, request_id: int, deadline_ms: float) -> None:
        """Sends a request once more, by its old id, unless its outcome is here already.

        There may be none because nobody waited for it, because Ctrl-C took a part of its reply
        along, or because its deadline has passed; it has a new one then.
        """
        delivery = self._arrived.get(request_id)
        if delivery is not None and delivery.unsettled is not None:
            self._pending[request_id] = delivery.unsettled
            del self._arrived[request_id]
        pending = self._pending.get(request_id)
        if pending is not None:
            pending.set_deadline(deadline_ms)
            pending.sent = 0

    def abandon(self, request_id: int) -> None:
        """The reply is not wanted any more. The server may execute the request all the same."""
        self._pending.pop(request_id, None)
        self._arrived.pop(request_id, None)

    def abandon_all(self) -> None:
        """Abandons everything in flight."""
        self._pending.clear()
        self._arrived.clear()

    def _transmit(self, request_id: int, pending: Pending) -> bool:
        now = time.monotonic()
        remaining_ms = math.ceil((pending.deadline - now) * 1000)
        head = Request(
            protocol_version=limits.PROTOCOL_VERSION,
            session_token=self._token,
            request_id=request_id,
            deadline_ms=min(max(remaining_ms, 1), limits.MAX_DEADLINE_MS),
        )
        # Before the first handshake a message waits in the queue of connection 1 and is not lost.
        pending.connection = max(self._handshakes, 1)
        # Two serialised messages after one another are their union.
        frames = [head.SerializeToString() + pending.envelope]
        if pending.payload:
            frames.append(pending.payload)
        try:
            self._socket.send_multipart(frames, zmq.NOBLOCK)
        except zmq.Again:
            pending.sent = now
            return False
        except zmq.ZMQError as error:
            raise self._broken(error) from error
        pending.sent = now
        return True

    def _pump(self) -> None:
        """Takes one message off the socket, or waits for one and does what is due meanwhile."""
        frames = self._read()
        if frames is None:
            self._resend()
        # Nothing expires while its reply may still be in the queue, unless that is full of noise.
        if frames is None or not self._accept(frames):
            self._expire()

    def _read(self) -> list[zmq.Frame] | None:
        wait_ms = math.ceil((self._next_wake() - time.monotonic()) * 1000)
        try:
            if wait_ms < sockets.LONGEST_BLOCK_MS and not self._socket.poll(max(wait_ms, 0)):
                return None
            return self._socket.recv_multipart(copy=False)
        except zmq.Again:
            return None
        except zmq.ZMQError as error:
            raise self._broken(error) from error

    def _broken(self, error: zmq.ZMQError) -> errors.B4mrlError:
        return errors.UnavailableError(f"the socket towards {self.address} failed: {error}")

    def _next_wake(self) -> float:
        """When the first pending request is to be sent again or given up."""
        return min(
            min(pending.deadline, self._resend_time(pending)) for pending in self._pending.values()
        )

    def _resend_time(self, pending: Pending) -> float:
        if pending.sent == 0:
            return 0
        return max(pending.sent, self._last_reply) + pending.patience

    def _accept(self, frames: list[zmq.Frame]) -> bool:
        """Settles the request that a message answers; False if it answers none."""
        try:
            reply = Reply.FromString(frames[0].bytes)
        except DecodeError:
            return False
        pending = self._pending.pop(reply.request_id, None)
        if pending is None or len(frames) > 2:
            return False
        self._last_reply = time.monotonic()
        delivery = read_reply(reply, frames)
        error = delivery.error
        if error is not None and error.recoverable and pending.resent:
            # One copy was turned away; another may still be executed.
            delivery.executed, delivery.unsettled = None, pending
        self._arrived[reply.request_id] = delivery
        return True

    def _resend(self) -> None:
        handshakes = self.handshakes
        if handshakes == 0:
            return  # all of it is still queued for the first connection
        now = time.monotonic()
        for request_id, pending in self._pending.items():
            is_reconnected = pending.connection < handshakes
            if is_reconnected and not pending.renewed:
                pending.renewed = True
                pending.deadline = max(pending.deadline, now + pending.patience)
            if is_reconnected or self._resend_time(pending) <= now:
                pending.resent = True
                # A full queue is no loss: the next silence, reconnection or deadline settles it.
                self._transmit(request_id, pending)

    def _expire(self) -> None:
        now = time.monotonic()
        for request_id in [i for i, pending in self._pending.items() if pending.deadline <= now]:
            pending = self._pending.pop(request_id)
            error = self._give_up(pending)
            self._arrived[request_id] = Delivery(
                request_id, error=error, executed=None, unsettled=pending
            )

    def _give_up(self, pending: Pending) -> errors.B4mrlError:
        """Why a request has no answer, with all that its sender may want to change."""
        name = Request.FromString(pending.envelope).WhichOneof("payload")
        within = f"within {pending.deadline_ms / 1000:g} s (deadline_ms={pending.deadline_ms:g})"
        if self.handshakes == 0:
            return errors.UnavailableError(
                f"{self.address} cannot be reached {within}, so {name} was not sent"
            )
        return errors.DeadlineExceededError(
            f"no answer to {name} from {self.address} {within}; the same call may be made again, "
            "and on a busy machine with a longer deadline_ms of connect or make"
        )


@atexit.register
def close_all() -> None:
    """When the program ends: closes the connections of this thread and of those that have ended."""
    for connection in list(_all):
        if connection.is_free:
            connection.close()
