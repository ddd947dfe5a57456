"""Requests on their way, and what becomes of them."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import zmq

from b4mrl import errors
from b4mrl.wire import arrays

_PATIENCE_FRACTION = 8  # of a deadline, in silence, before a request is sent again


@dataclass(slots=True)
class Delivery:
    """What became of one request: a reply, or an error.

    Attributes:
        reply: the Reply, whose status is OK; None with an error.
        arrays: the reply's arrays, writable.
        executed: True, False, or None when that is not known.
        unsettled: what ask_again needs where the next answer may tell.
    """

    request_id: int
    reply: Any = None
    arrays: dict[str, arrays.Array] = field(default_factory=dict)
    error: errors.B4mrlError | None = None
    executed: bool | None = True
    unsettled: Pending | None = None


@dataclass(slots=True)
class Pending:
    """A request that has not been answered. Times are seconds of time.monotonic()."""

    envelope: bytes  # without version, token, id and deadline
    payload: bytearray
    deadline_ms: float = 0.0  # as the caller gave it
    deadline: float = 0.0
    patience: float = 0.0
    connection: int = 0  # the number of the connection that it was last sent over
    sent: float = 0.0  # 0: not yet, or to be sent again at once
    resent: bool = False
    renewed: bool = False  # its deadline, after a reconnection

    def set_deadline(self, deadline_ms: float) -> None:
        seconds = deadline_ms / 1000
        self.deadline_ms = deadline_ms
        self.deadline = time.monotonic() + seconds
        self.patience = seconds / _PATIENCE_FRACTION
        self.renewed = False


def read_reply(reply: Any, frames: list[zmq.Frame]) -> Delivery:
    """The delivery that a Reply and its message of at most two frames are."""
    status = reply.status
    if status.code != 0:
        error = errors.error_of(status.code, status.message, status.recoverable)
        executed = None if error.executed_unknown else False
        return Delivery(reply.request_id, error=error, executed=executed)
    payload = bytearray(frames[1].buffer) if len(frames) > 1 else bytearray()
    try:
        return Delivery(reply.request_id, reply, arrays.unpack(reply.arrays, payload))
    except errors.InternalError as error:
        return Delivery(reply.request_id, error=error, executed=None)
