"""Closes sessions that the program did not close: when Python collects them, and when it ends.

In children of multiprocessing, other modules may have things done behind that (call_at_the_end).

If a program is ended by SIGKILL or os._exit, its sessions stay until the daemon's lease runs out.
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
from collections.abc import Callable
from typing import Any

from b4mrl import errors
from b4mrl.wire.connection import Connection
from b4mrl.wire.messages import Request

FAREWELL_MS = 500  # deadline of a session's last request, whose daemon may have ended

_open: dict[int, Connection] = {}  # connections of the open sessions, by id()
_last_calls: list[Callable[[], object]] = []  # of call_at_the_end
_watched_process = 0  # id of the process in which _watch_the_end was called


def _close_request() -> Any:
    request = Request()
    request.close.SetInParent()
    return request


def say_farewell(connection: Connection) -> None:
    """Closes a session, through a door even if its worker is replaced now, and the connection."""
    if connection.is_usable:
        connection.abandon_all()  # makes room for one more, if as many as allowed are in flight
        with contextlib.suppress(errors.B4mrlError):
            request_id = connection.send(_close_request(), bytearray(), FAREWELL_MS)
            if connection.transport == "door":  # whose worker may have been replaced
                connection.receive(request_id)
    connection.close(linger_ms=FAREWELL_MS)


class Farewell:
    """Closes a session and its connection: in `take_leave`, or when the session is collected.

    Owned by the session, which is otherwise not referred to.
    """

    def __init__(self, session: object, connection: Connection) -> None:
        self._connection = connection
        _open[id(connection)] = connection
        self._when_collected = weakref.finalize(session, _leave_in_passing, connection)
        self._when_collected.atexit = False  # give_back_all closes all sessions at once
        _watch_the_end()

    @property
    def is_due(self) -> bool:
        """Whether the session is open: False after take_leave."""
        return self._when_collected.alive

    def take_leave(self, deadline_ms: float) -> None:
        """Closes the session at the daemon, then the connection. May be called again.

        Errors of the daemon are ignored. FailedPreconditionError: another thread is in a call.
        """
        self._connection.require_alone()
        if self._when_collected.detach() is None:
            return
        _open.pop(id(self._connection), None)
        _leave([self._connection], min(deadline_ms, FAREWELL_MS))


def call_at_the_end(call: Callable[[], object]) -> None:
    """Has `call` called when this child of multiprocessing ends, after its sessions are closed.

    A process that such a child forks calls it, too.
    """
    _last_calls.append(call)
    _watch_the_end()


def give_back_all() -> None:
    """Closes the open sessions of this process, within half a second in all.

    Sessions that another running thread has used last stay open: that thread may be in a call.
    """
    _leave([each for each in list(_open.values()) if each.is_usable and each.is_free], FAREWELL_MS)


def _leave(connections: list[Connection], deadline_ms: float) -> None:
    asked: list[tuple[Connection, int]] = []
    try:
        for connection in connections:
            connection.abandon_all()  # makes room for one more, if as many as allowed are in flight
            with contextlib.suppress(errors.B4mrlError):
                asked.append(
                    (connection, connection.send(_close_request(), bytearray(), deadline_ms))
                )
        for connection, request_id in asked:
            with contextlib.suppress(errors.B4mrlError):
                connection.receive(request_id)
    finally:
        for connection in connections:
            connection.close()


def _leave_in_passing(connection: Connection) -> None:
    """Closes a collected session without waiting for the daemon's reply."""
    _open.pop(id(connection), None)
    say_farewell(connection)


def _watch_the_end() -> None:
    """Has give_back_all called when this process ends. Works once for each process.

    Children of multiprocessing, such as the workers of AsyncVectorEnv and SubprocVecEnv, skip
    atexit before Python 3.13 and run multiprocessing's finalizers instead. Daemonic children get
    SIGTERM when their parent ends.
    """
    global _watched_process
    if _watched_process == os.getpid():
        return
    _watched_process = os.getpid()
    atexit.register(give_back_all)
    if multiprocessing.parent_process() is not None:
        _watch_the_childs_end()


def _watch_the_childs_end() -> None:
    multiprocessing.util.Finalize(None, _end, exitpriority=100)
    is_main = threading.current_thread() is threading.main_thread()
    is_free = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    if multiprocessing.current_process().daemon and is_main and is_free:
        signal.signal(signal.SIGTERM, _give_back_and_end)


def _after_fork(_: object) -> None:
    """Has a child of multiprocessing watched that was given sessions as it was begun.

    Unless it is a fork, they are unpickled before it counts as a child, and what is to be done at
    its end is forgotten as it begins to. A spawned one ends by way of atexit all the same, a
    forkserver's does not.
    """
    if _watched_process == os.getpid():
        _watch_the_childs_end()


multiprocessing.util.register_after_fork(_after_fork, _after_fork)


def _end() -> None:
    give_back_all()
    for call in _last_calls:
        call()


def _give_back_and_end(number: int, _: object) -> None:
    signal.signal(number, signal.SIG_DFL)
    _end()
    os.kill(os.getpid(), number)
