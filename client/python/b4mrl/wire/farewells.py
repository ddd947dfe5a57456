"""Sessions that nobody closed are given back: when they are collected, and when the program ends.

What ends a program without asking it (SIGKILL, os._exit) leaves them to the server's lease.
"""

from __future__ import annotations

import atexit
import contextlib
import multiprocessing
import multiprocessing.util
import os
import signal
import threading
import weakref
from typing import Any

from b4mrl import errors
from b4mrl.wire.connection import FAREWELL_MS, Connection
from b4mrl.wire.messages import Request

_open: dict[int, Connection] = {}  # of the sessions that were not closed, by id()
_watched_process = 0  # whose end is watched


def close_request() -> Any:
    request = Request()
    request.close.SetInParent()
    return request


class Farewell:
    """Owned by a session, whose connection it closes: by `take_leave`, or by itself."""

    def __init__(self, session: object, connection: Connection) -> None:
        self._connection = connection
        _open[id(connection)] = connection
        self._when_collected = weakref.finalize(session, _leave_in_passing, connection)
        self._when_collected.atexit = False  # give_back_all does it for all of them at once
        _watch_the_end()

    @property
    def is_due(self) -> bool:
        """False once it was taken."""
        return self._when_collected.alive

    def take_leave(self, deadline_ms: float) -> None:
        """Closes the session at the server and then the connection. May be called again.

        The server's errors are of no use any more.
        """
        if self._when_collected.detach() is None:
            return
        _open.pop(id(self._connection), None)
        _leave([self._connection], min(deadline_ms, FAREWELL_MS))


def give_back_all() -> None:
    """Closes every session of this process that is still open, within half a second in all.

    Except those of other threads that run on: a connection is for one thread at a time.
    """
    _leave([each for each in list(_open.values()) if each.is_usable and each.is_free], FAREWELL_MS)


def _leave(connections: list[Connection], deadline_ms: float) -> None:
    asked: list[tuple[Connection, int]] = []
    try:
        for connection in connections:
            connection.abandon_all()  # as many as may be in flight must not keep this one back
            with contextlib.suppress(errors.B4mrlError):
                asked.append(
                    (connection, connection.send(close_request(), bytearray(), deadline_ms))
                )
        for connection, request_id in asked:
            with contextlib.suppress(errors.B4mrlError):
                connection.receive(request_id)
    finally:
        for connection in connections:
            connection.close()


def _leave_in_passing(connection: Connection) -> None:
    """Where the collector must not be kept waiting."""
    _open.pop(id(connection), None)
    connection.farewell(close_request())


def _watch_the_end() -> None:
    """Once a process: a forked child has an end of its own.

    Children of multiprocessing, such as the workers of AsyncVectorEnv and SubprocVecEnv, skip
    atexit before Python 3.13 and run finalizers of multiprocessing's own instead; daemonic ones are
    ended by SIGTERM when their parent ends.
    """
    global _watched_process
    if _watched_process == os.getpid():
        return
    _watched_process = os.getpid()
    atexit.register(give_back_all)
    if multiprocessing.parent_process() is None:
        return
    multiprocessing.util.Finalize(None, give_back_all, exitpriority=100)
    is_main = threading.current_thread() is threading.main_thread()
    is_free = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if multiprocessing.current_process().daemon and is_main and is_free:
        signal.signal(signal.SIGTERM, _give_back_and_end)


def _give_back_and_end(number: int, _: object) -> None:
    signal.signal(number, signal.SIG_DFL)
    give_back_all()
    os.kill(os.getpid(), number)
