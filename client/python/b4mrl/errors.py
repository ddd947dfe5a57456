"""What goes wrong, as exceptions: one class for each status code of the protocol.

All derive from B4mrlError. Where Python has a word for the same thing, the class is that too, so
`except TimeoutError`, `except ConnectionError` and `except ValueError` work as expected. The text
is the server's own: it names the offending thing, its value and what is allowed.
"""

from __future__ import annotations

from typing import Any


class B4mrlError(Exception):
    """An error of the daemon, or on the way to it.

    Attributes:
        code: the status code of the protocol, 1 to 15.
        recoverable: the same request may succeed later, unchanged.
        executed_unknown: the operation may have been executed or not, so that the lanes it was for
            are of no more use.
        env_ids: the lanes of the failed request where `recv` raises it; else None.
    """

    code = 15
    executed_unknown = False

    def __init__(self, message: str, *, recoverable: bool = False) -> None:
        super().__init__(message)
        self.recoverable = recoverable
        self.env_ids: Any = None


class InvalidArgumentError(B4mrlError, ValueError):
    """A value is malformed or outside its range."""

    code = 1


class UnknownNameError(B4mrlError, LookupError):
    """No such environment, perturbation or dataset; the nearest known name is in the text."""

    code = 2


class UnsupportedError(B4mrlError):
    """Known, but not in this combination or not by this server."""

    code = 3


class BusyError(B4mrlError):
    """The lane has another request under way."""

    code = 4


class StaleError(B4mrlError):
    """A step number below the lane's last one: two programs share a session."""

    code = 5
    executed_unknown = True


class GapError(B4mrlError):
    """A step number beyond the lane's next one: two programs share a session."""

    code = 6
    executed_unknown = True


class LimitExceededError(B4mrlError):
    """A documented limit, named in the text."""

    code = 7


class DeadlineExceededError(B4mrlError, TimeoutError):
    """No answer in time, or the server did not get to the request in time."""

    code = 8


class UnavailableError(B4mrlError, ConnectionError):
    """The server cannot be reached, or is stopping."""

    code = 9


class VersionMismatchError(B4mrlError):
    """Two versions of the protocol, or a state of another engine version; both are in the text."""

    code = 10


class SessionLostError(B4mrlError):
    """The session was closed, was idle for longer than the server's lease, or never was."""

    code = 11
    executed_unknown = True


class DataLossError(B4mrlError):
    """A file is truncated, corrupt or inconsistent."""

    code = 12
    executed_unknown = True


class ServerIoError(B4mrlError, OSError):
    """The server's operating system refused a read or a write."""

    code = 13
    executed_unknown = True


class FailedPreconditionError(B4mrlError):
    """The call does not fit the state it meets, such as a step before the first reset."""

    code = 14


class InternalError(B4mrlError):
    """A mistake of the server, or a reply that cannot be understood."""

    code = 15
    executed_unknown = True


_BY_CODE: dict[int, type[B4mrlError]] = {kind.code: kind for kind in B4mrlError.__subclasses__()}


def error_of(code: int, message: str, recoverable: bool) -> B4mrlError:
    """The exception for a status of the wire; an unknown code counts as InternalError."""
    return _BY_CODE.get(code, InternalError)(message, recoverable=recoverable)
