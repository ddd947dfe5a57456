"""The exceptions of the package: one class for each status code of the protocol.

All derive from B4mrlError. Where Python has a matching exception, the class derives from it, too:
`except TimeoutError`, `except ConnectionError` and `except ValueError` work as expected. The
message is the daemon's: it names the argument, its value and the allowed range.
"""

from __future__ import annotations

import difflib
import os
import re
import sys
import warnings
from collections.abc import Iterable
from typing import Any


class B4mrlError(Exception):
    """An error that the daemon answered, or that kept a request from being answered.

    Attributes:
        code: the status code of the protocol, 1 to 15.
        recoverable: whether the same request may succeed later, unchanged: as the daemon says or,
            of an error that the client found, as is usual of its class.
        executed_unknown: whether the operation may have been executed or not. If `recoverable` is
            set, too, as after a deadline, the same call again settles that: a step is executed
            once, however often it is asked for. Else its environments cannot be used any more.
        env_ids: the environments of the failed send if `recv` raised the error; else None.
    """

    code = 15
    executed_unknown = False
    recoverable = False

    def __init__(self, message: str, *, recoverable: bool | None = None) -> None:
        super().__init__(message)
        if recoverable is not None:
            self.recoverable = recoverable
        self.env_ids: Any = None


class InvalidArgumentError(B4mrlError, ValueError):
    """A value is malformed or outside its range."""

    code = 1


class UnknownNameError(B4mrlError, LookupError):
    """There is no such environment, perturbation or dataset; the message has the nearest name."""

    code = 2


class UnsupportedError(B4mrlError):
    """The request is known, but not in this combination or not to this daemon."""

    code = 3


class BusyError(B4mrlError):
    """The lane has another request under way."""

    code = 4
    recoverable = True


class StaleError(B4mrlError):
    """A step's number is below the lane's last one: two programs share a session."""

    code = 5
    executed_unknown = True


class GapError(B4mrlError):
    """A step's number is beyond the lane's next one: two programs share a session."""

    code = 6
    executed_unknown = True


class LimitExceededError(B4mrlError):
    """A limit of proto/PROTOCOL.md, named in the message, is reached for the moment."""

    code = 7
    recoverable = True


class DeadlineExceededError(B4mrlError, TimeoutError):
    """The reply did not come in time, or the daemon did not start the request in time."""

    code = 8
    recoverable = True


class UnavailableError(B4mrlError, ConnectionError):
    """The daemon cannot be reached, or is stopping."""

    code = 9
    recoverable = True


class VersionMismatchError(B4mrlError):
    """The protocol's or an engine's versions differ; the message has both of them."""

    code = 10


class SessionLostError(B4mrlError):
    """The session was closed, was idle for longer than the daemon's lease, or never existed."""

    code = 11
    executed_unknown = True


class DataLossError(B4mrlError):
    """A file is truncated, corrupt or inconsistent."""

    code = 12
    executed_unknown = True


class ServerIoError(B4mrlError, OSError):
    """The daemon's operating system refused a read or a write."""

    code = 13
    executed_unknown = True


class FailedPreconditionError(B4mrlError):
    """The call does not fit the environment's state, such as a step before the first reset."""

    code = 14


class InternalError(B4mrlError):
    """A fault of the daemon, or a malformed reply."""

    code = 15
    executed_unknown = True


_VERSION = re.compile(r"-v\d+$")  # at the end of a name
_LEAST_LIKENESS = 2 / 3  # of a name that may have been meant; 1: equal names


def without_version(name: str) -> str:
    """`name` without the version at its end, the "-v0" of "HalfCheetah/medium-v0"."""
    return _VERSION.sub("", name)


def nearest_name(name: str, known: Iterable[str]) -> str | None:
    """The known name that `name` may be a misspelling of; None if none resembles it.

    Capital letters count for nothing, nor does a folder that both begin with, as it would make any
    two names in "HalfCheetah/" resemble each other, nor a version, "-v0", where `name` has none.
    """
    nearest, most = None, _LEAST_LIKENESS
    own = name.casefold()
    has_version = own != without_version(own)
    for each in dict.fromkeys(known):
        other = each.casefold() if has_version else without_version(each.casefold())
        folder = os.path.commonprefix([own, other]).rfind("/") + 1
        likeness = difflib.SequenceMatcher(None, own[folder:], other[folder:]).ratio()
        if likeness > most:
            nearest, most = each, likeness
    return nearest


def unknown_name(kind: str, name: str, known: Iterable[str], hint: str) -> UnknownNameError:
    """An UnknownNameError with the nearest known name; `hint` says where all names are listed."""
    nearest = nearest_name(name, known)
    meant = "" if nearest is None else f"; did you mean {nearest!r}?"
    return UnknownNameError(f"unknown {kind} {name!r}{meant} ({hint})")


def connection_closed() -> FailedPreconditionError:
    """The error of a call after the connection's end."""
    return FailedPreconditionError("the connection is closed; make a new one")


def another_thread() -> FailedPreconditionError:
    """The error of a second thread."""
    return FailedPreconditionError(
        "another thread is in a call of this environment, client or dataset; "
        "allowed: one thread at a time"
    )


_BY_CODE: dict[int, type[B4mrlError]] = {kind.code: kind for kind in B4mrlError.__subclasses__()}


def error_of(code: int, message: str, recoverable: bool) -> B4mrlError:
    """The exception for a status of a reply; an unknown code becomes an InternalError."""
    return _BY_CODE.get(code, InternalError)(message, recoverable=recoverable)


def warn(text: str) -> None:
    """A RuntimeWarning at the line that called the package, from however deep inside it."""
    frame, level = sys._getframe(1), 2
    inside = (__name__.partition(".")[0], "functools", "contextlib")  # these stand between its own
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in inside:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, RuntimeWarning, stacklevel=level)
