"""Pending requests, and their outcomes: replies or errors."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from b4mrl import errors
from b4mrl.wire.arrays import Array
from b4mrl.wire.link import Message
from b4mrl.wire.messages import Request
from b4mrl.wire.tables import Table, Tables

# A request is sent again when 1/8 of its deadline has passed without a reply to it or an earlier
# one, then after twice as long, and so on: over a slow link a large reply may still be on its way,
# and each copy of the request brings another reply, which takes its room.
_PATIENCE_FRACTION = 8


@dataclass(slots=True)
class Delivery:
    """The outcome of one request: a reply, or an error.

    Attributes:
        reply: the Reply, whose status is OK; None with an error. `table` stands for its arrays.
        table: where the reply's arrays are in `payload`; None with an error.
        payload: the bytes of the reply's arrays.
        error: the daemon's error, or one of this client; None with a reply.
        unsettled: the request, if sending it again can tell whether it was executed. Else nothing
            can, and with `executed` None, the request's lanes cannot be used any more.
    """

    request_id: int
    reply: Any = None
    table: Table | None = None
    payload: bytearray | None = None
    error: errors.B4mrlError | None = None
    unsettled: Pending | None = None

    @property
    def executed(self) -> bool | None:
        """Whether the daemon executed the request; None if that is not known."""
        if self.error is None:
            return True
        return None if self.error.executed_unknown else False

    @property
    def arrays(self) -> dict[str, Array]:
        """The reply's arrays, as new writable views of `payload`."""
        if self.table is None or self.payload is None:
            return {}
        return self.table.unpack(self.payload)


@dataclass(slots=True)
class Pending:
    """A request without a reply. Times are seconds of time.monotonic()."""

    envelope: bytes  # without version, token, id and deadline
    payload: bytearray
    deadline_ms: float = 0.0  # as the caller gave it
    deadline: float = 0.0
    asked: float = 0.0  # time at which the deadline was set
    patience: float = 0.0  # an eighth of the deadline, in seconds
    interval: float = 0.0  # seconds without such a reply after which the request is sent again
    connection: int = 0  # number of the connection over which it was last sent, from 1
    sent: float = 0.0  # time of the last sending; 0: send at once
    heard: float = 0.0  # time of the last reply to a request that was sent before this one
    resent: bool = False  # it was sent more than once
    renewed: bool = False  # its deadline was extended after a reconnection

    def set_deadline(self, deadline_ms: float) -> None:
        seconds = deadline_ms / 1000
        self.deadline_ms = deadline_ms
        self.asked = time.monotonic()
        self.deadline = self.asked + seconds
        self.patience = self.interval = seconds / _PATIENCE_FRACTION
        self.renewed = False

    def renew(self, now: float) -> None:
        """Gives it time for an answer after the first reconnection, if little is left."""
        if not self.renewed:
            self.renewed = True
            self.deadline = max(self.deadline, now + self.patience)

    def wait_longer(self) -> None:
        """Doubles the interval before the next sending, unless ask_again has begun a new one."""
        if self.sent:
            self.interval *= 2

    @property
    def resend_time(self) -> float:
        """The time at which it is sent again."""
        return max(self.sent, self.heard) + self.interval if self.sent else 0


def left_open(request_id: int, pending: Pending, error: errors.B4mrlError) -> Delivery:
    """The outcome of a request that may have been executed all the same, or may yet be."""
    error.executed_unknown = True
    return Delivery(request_id, error=error, unsettled=pending)


def note_reply(pending: dict[int, Pending], request_id: int) -> None:
    """Notes, for the requests that were sent after `request_id`, that a reply to it has come.

    Replies to later ones do not show that the server has a request, and a reply with the id 0 names
    none.
    """
    if pending and request_id:
        now = time.monotonic()
        for other, entry in pending.items():
            if other > request_id:
                entry.heard = now


def no_reply(
    pending: Pending, address: str, was_reached: bool, is_refused: bool
) -> errors.B4mrlError:
    """The error of a request that got no reply; it names what the caller may change.

    Args:
        was_reached: whether there ever was a connection to `address`.
        is_refused: whether nobody listens there now.
    """
    name = Request.FromString(pending.envelope).WhichOneof("payload")
    within = f"within {pending.deadline_ms / 1000:g} s (deadline_ms={pending.deadline_ms:g})"
    if is_refused:
        no_more = " any more" if was_reached else ""
        return errors.UnavailableError(
            f"no answer to {name}: nobody listens at {address}{no_more}; has the daemon ended? "
            "Start it, and make clients and environments anew",
            recoverable=False,
        )
    if not was_reached:
        return errors.UnavailableError(
            f"{address} cannot be reached {within}, so {name} was not sent"
        )
    return errors.DeadlineExceededError(
        f"no answer to {name} from {address} {within}; the same call may be made again, "
        "and on a busy machine with a longer deadline_ms of connect or make"
    )


def read_reply(tables: Tables, message: Message) -> Delivery:
    """The outcome in a message. DecodeError: its envelope is no Reply."""
    envelope, payload = message
    reply, table = tables.read(envelope, payload)
    request_id, status = reply.request_id, reply.status
    if status.code != 0:
        error = errors.error_of(status.code, status.message, status.recoverable)
        return Delivery(request_id, error=error)
    try:
        table = table or tables.learn(envelope, reply, payload)
    except errors.InternalError as error:
        return Delivery(request_id, error=error)
    return Delivery(request_id, reply, table, payload)
