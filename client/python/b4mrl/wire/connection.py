"""A connection to one process of the daemon, which outlives a replacement of the process.

The connection keeps every request, payload included, until the reply has come or the deadline has
passed. It sends the request again, with the same id and contents and the time that is left,

- after a reconnection: the process may be a replacement, which has none of the old one's requests.
  At the first reconnection, a request gets at least an eighth of its deadline, since the caller may
  not have read replies for a while;
- when no reply to it, or to one that was sent before it, has come for an eighth of its deadline,
  and then for twice as long, and so on.

Where nobody listens on the daemon's machine, it has ended or was never started
(b4mrl.wire.listening). Requests are then given up after ten seconds, long enough to start the
daemon again, if their own deadlines are not shorter.

The daemon executes a numbered step once, however often it arrives. Replies that come twice, or after
their request was given up, are dropped.
Thread rule: one thread at a time; a second one gets FailedPreconditionError while the first is in a
call, which it may close. One thread may send and another one receive later. In a forked child,
calls raise FailedPreconditionError, too.
"""

from __future__ import annotations

import atexit
import math
import os
import threading
import time
import weakref
from collections.abc import Iterable
from typing import Any

from google.protobuf.message import DecodeError

from b4mrl import errors
from b4mrl.wire import limits, sockets
from b4mrl.wire.deliveries import Delivery, Pending, left_open, no_reply, note_reply, read_reply
from b4mrl.wire.heads import Heads
from b4mrl.wire.link import Link, Message
from b4mrl.wire.listening import Listening
from b4mrl.wire.tables import Tables

# A request's default deadline: long, so that a busy machine does not end a training of hours.
DEADLINE_MS = 120_000
REACH_MS = 10_000  # wait for a daemon that nobody may have started, or that has ended
_MOST_BYTES = limits.MAX_ENVELOPE_BYTES - 64  # of a request, without version, token, id, deadline
_QUIET_SECONDS = 1.0  # a request waits for so long before anything looks for the daemon's end

# What a call may raise when a signal handler has closed the connection in the middle of it, and its
# requests are gone.
_ODD = (LookupError, RuntimeError, ValueError)

_all: weakref.WeakSet[Connection] = weakref.WeakSet()


class Connection:
    """Requests to, and replies from, the process that listens on `address`.

    Args:
        address: "tcp://HOST:PORT" or "ipc://PATH". Requests wait until the connection is made.
        token: the session's 16 bytes, or b"" for requests that belong to no session.
        link: a faster way to the process that listens there; owned by the connection, which goes on
            at `address` when the link is refused. None: there is none.
        is_relayed: whether the process at `address` hands messages on to another one.

    Raises:
        InvalidArgumentError: `address` is malformed.
        UnavailableError: the system has no more sockets.
    """

    def __init__(
        self, address: str, token: bytes = b"", link: Link | None = None, is_relayed: bool = False
    ) -> None:
        self.address = address
        self._is_relayed = is_relayed
        self._user = 0  # the thread that sent the last request
        self._inside = 0  # the thread that is in a call; 0: none
        self._is_ending = False  # close was called
        self._heads = Heads(token)
        self.next_id = 1  # that the next send will return
        self._handshakes = 0
        self._looked = 0.0  # when _resend was last called
        self._pending: dict[int, Pending] = {}
        self._arrived: dict[int, Delivery] = {}
        self._tables = Tables()
        self._take_link(link or sockets.open_link(address))
        self._listening = Listening(self._link.address)
        _all.add(self)

    @property
    def transport(self) -> str:
        """How messages travel now: "door", "ipc", "tcp" or "relay"."""
        return "relay" if self._is_relayed else self._link.transport

    @property
    def is_usable(self) -> bool:
        """Whether requests may be sent: False after close, and in a forked child."""
        return self._close_link.alive and not self._is_ending and not self.is_inherited

    @property
    def is_free(self) -> bool:
        """Whether no other running thread is in a call, or has sent the last request."""
        others = {thread.ident for thread in threading.enumerate()} - {threading.get_ident()}
        return self._user not in others and self._inside not in others

    @property
    def is_inherited(self) -> bool:
        """Whether this process is a forked child of the one that opened the connection."""
        return self._link.process_id != os.getpid()

    @property
    def is_foreign(self) -> bool:
        """Whether this process is a forked child and the parent had the connection open."""
        return self._close_link.alive and self.is_inherited

    def close(self, linger_ms: int = 0) -> None:
        """Closes the link and gives up unanswered requests.

        Queued requests are sent on for up to `linger_ms`: by ZeroMQ in the background, by a door
        before this call returns. A thread that is in a call gets an error and closes the link.
        """
        self._pending.clear()
        self._is_ending = True  # first, so that one of the two threads closes it
        is_read = self._inside not in (0, threading.get_ident()) and not self.is_inherited
        if not is_read and self._close_link.detach() is not None:
            self._link.close(linger_ms)

    @property
    def handshakes(self) -> int:
        """How often the connection was made; more than once if the process was replaced."""
        self._handshakes += self._link.take_handshakes()
        return self._handshakes

    def await_handshake(self, timeout_ms: float) -> bool:
        """Waits for the first connection, at most `timeout_ms`; returns whether it was made."""
        finish = time.monotonic() + timeout_ms / 1000
        while self.handshakes == 0:
            wait_ms = math.ceil((finish - time.monotonic()) * 1000)
            if wait_ms <= 0:
                return False
            self._link.await_handshake(min(wait_ms, 60_000))  # of a C int at most
        return True

    def is_in_flight(self, request_id: int) -> bool:
        """Whether a request waits for its reply, or the reply waits to be received."""
        return request_id in self._pending or request_id in self._arrived

    def send(
        self, request: Any, payload: bytearray, deadline_ms: float, *, is_awaited: bool = False
    ) -> int:
        """Sends a request and returns its id.

        Args:
            request: a Request, or its bytes, with one of the requests in `payload` and the table of
                its arrays; send adds version, token, id and deadline.
            payload: the arrays' bytes; empty without arrays. The connection keeps this object, so
                the caller must not change it.
            deadline_ms: time limit for the reply, in milliseconds.
            is_awaited: the caller awaits the reply at once, so those that the connection keeps for
                others do not count as requests in flight.

        Raises:
            LimitExceededError: too many requests are in flight.
            InvalidArgumentError: the envelope is too long.
            UnavailableError: the queue towards the daemon is full.
            FailedPreconditionError: the connection was closed, or made before a fork, or another
                thread is in a call.
        """
        user = self.require_alone()
        self._user = user
        self._refuse_unusable()
        most = limits.MAX_REQUESTS_IN_FLIGHT
        if len(self._pending) + (0 if is_awaited else len(self._arrived)) >= most:
            raise errors.LimitExceededError(f"allowed: at most {most} requests in flight")
        envelope = request if isinstance(request, bytes) else request.SerializeToString()
        if len(envelope) > _MOST_BYTES:
            raise errors.InvalidArgumentError(
                f"the request has {len(envelope)} bytes beside its arrays, "
                f"allowed: at most {_MOST_BYTES}"
            )
        request_id = self.next_id
        pending = Pending(envelope, payload)
        pending.set_deadline(deadline_ms)
        # The request is kept before it is sent, so that Ctrl-C in between does not lose it.
        self.next_id += 1
        self._pending[request_id] = pending
        try:
            self._inside = user
            is_sent = self._transmit(request_id, pending)
        finally:
            self._step_out()
        if not is_sent:
            self._pending.pop(request_id, None)
            raise errors.UnavailableError("the queue of requests to the daemon is full")
        return request_id

    def receive(self, request_id: int) -> Delivery:
        """Waits for a request's reply, at most until its deadline, and returns reply or error."""
        return self.receive_any((request_id,))

    def reply_to(self, request_id: int) -> Delivery:
        """As receive, but raises the error."""
        delivery = self.receive(request_id)
        if delivery.error is not None:
            raise delivery.error
        return delivery

    def receive_any(self, request_ids: Iterable[int]) -> Delivery:
        """Waits until the first of the requests has a reply or an error, and returns that.

        FailedPreconditionError: none of the requests is in flight, or another thread is in a call.
        """
        delivery = self.await_any(request_ids)
        del self._arrived[delivery.request_id]
        return delivery

    def await_any(self, request_ids: Iterable[int]) -> Delivery:
        """As receive_any, but keeps the delivery: the next call returns it again until abandon."""
        user = self.require_alone()
        try:
            self._inside = user
            while True:
                for request_id in request_ids:
                    if request_id in self._arrived:
                        return self._arrived[request_id]
                self._refuse_unusable()
                if self._pending.keys().isdisjoint(request_ids):
                    raise errors.FailedPreconditionError("no such request is in flight")
                self._pump()
        except _ODD:
            self._refuse_unusable()
            raise
        finally:
            self._step_out()

    def _step_out(self) -> None:
        self._inside = 0
        if self._is_ending:
            self.close()

    def call(self, request: Any, payload: bytearray, deadline_ms: float) -> Delivery:
        """Sends a request, waits for its reply and returns it. Raises the daemon's error."""
        request_id = self.send(request, payload, deadline_ms, is_awaited=True)
        try:
            return self.reply_to(request_id)
        finally:
            self.abandon(request_id)  # after Ctrl-C, no other call would receive the reply

    def ask_again(self, request_id: int, deadline_ms: float) -> None:
        """Sends a request again, with its old id and a new deadline, unless it has its outcome.

        That may be missing because the reply was not waited for, or Ctrl-C interrupted its reading,
        or the deadline has passed.
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
        """Drops a request and its reply. The daemon may execute the request all the same."""
        self._pending.pop(request_id, None)
        self._arrived.pop(request_id, None)

    def abandon_all(self) -> None:
        """Drops all requests in flight and their replies."""
        self._pending.clear()
        self._arrived.clear()

    def require_alone(self) -> int:
        """The thread's identifier. FailedPreconditionError: another thread is in a call.

        A forked child has none of its parent's other threads.
        """
        user = threading.get_ident()
        if self._inside not in (0, user) and not self.is_inherited:
            raise errors.another_thread()
        return user

    def _refuse_unusable(self) -> None:
        if self.is_usable:
            return
        if self.is_foreign:
            raise errors.FailedPreconditionError(
                "the connection was made before a fork, in another process; connect again here"
            )
        raise errors.connection_closed()

    def _transmit(self, request_id: int, pending: Pending) -> bool:
        now = time.monotonic()
        remaining_ms = math.ceil((pending.deadline - now) * 1000)
        head = self._heads.of(request_id, min(max(remaining_ms, 1), limits.MAX_DEADLINE_MS))
        # A message that is sent before the first handshake goes over connection 1.
        pending.connection = max(self._handshakes, 1)
        is_sent = self._link.send(head + pending.envelope, pending.payload)
        pending.sent = now
        return is_sent

    def _pump(self) -> None:
        """Waits for one message and accepts it; resends and gives up requests that are due."""
        message = self._read()
        is_answer = message is not None and self._accept(message)
        # Where messages keep coming, no wait is empty.
        if message is None or time.monotonic() - self._looked >= 0.02:
            self._resend()
        # No request expires while the queue may still hold its reply: only when the queue is empty,
        # or held a message that answers no request.
        if not is_answer:
            self._expire()

    def _read(self) -> Message | None:
        wait_ms = math.ceil((self._next_wake() - time.monotonic()) * 1000)
        message = self._link.receive(wait_ms)
        if message is None and self._link.is_refused and self._close_link.alive:
            refused, self._handshakes = self._close_link, self.handshakes
            self._take_link(sockets.open_link(self.address))
            refused()
        return message

    def _take_link(self, link: Link) -> None:
        self._link: Link = link
        self._close_link = weakref.finalize(self, link.close)  # also when self is collected
        self._close_link.atexit = False  # close_all closes the link when the program ends

    def _next_wake(self) -> float:
        """The time at which the first pending request is sent again or given up."""
        wake = time.monotonic() + 60  # nothing is pending once a signal handler has closed it
        for pending in self._pending.values():
            wake = min(wake, pending.deadline)
            if self._handshakes:  # before the first one, nothing is sent again
                wake = min(wake, pending.resend_time)
        return wake

    def _end(self, pending: Pending) -> float:
        """The time at which a request is given up; earlier if the daemon has ended."""
        gone_since = self._listening.gone_since
        return min(pending.deadline, max(gone_since, pending.asked) + REACH_MS / 1000)

    def _accept(self, message: Message) -> bool:
        """Keeps a message as the reply to its request; False if it answers no pending request."""
        try:
            delivery = read_reply(self._tables, message)
        except DecodeError:
            return False
        request_id, error = delivery.request_id, delivery.error
        pending = self._pending.pop(request_id, None)
        note_reply(self._pending, request_id)  # by a second copy of a reply, too
        if pending is None:
            return False
        if error is not None and error.recoverable and pending.resent:
            # The daemon refused one copy of the request; another copy may still be executed.
            delivery = left_open(request_id, pending, error)
        self._arrived[request_id] = delivery
        return True

    def _resend(self) -> None:
        handshakes, now = self.handshakes, time.monotonic()
        self._looked = now
        if any(each.asked + _QUIET_SECONDS < now for each in self._pending.values()):
            self._listening.look(now)
        if handshakes == 0:
            return  # all requests are still queued for the first connection
        for request_id, pending in self._pending.items():
            if pending.connection < handshakes:
                pending.renew(now)
            elif pending.resend_time <= now:
                pending.wait_longer()
            else:
                continue
            pending.resent = True
            # With a full queue, the request is sent again later, or given up in the end.
            self._transmit(request_id, pending)

    def _expire(self) -> None:
        due = [i for i, each in self._pending.items() if self._end(each) <= time.monotonic()]
        is_refused = bool(due) and self._listening.is_refused()
        for request_id in due:
            pending = self._pending[request_id]
            error = no_reply(pending, self.address, self.handshakes > 0, is_refused)
            self._arrived[request_id] = left_open(request_id, pending, error)
            del self._pending[request_id]


@atexit.register
def close_all() -> None:
    """Closes, at the program's end, the connections that no other running thread has used last."""
    for connection in list(_all):
        if connection.is_free:
            connection.close()
