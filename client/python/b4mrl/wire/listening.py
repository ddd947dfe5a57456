"""Whether the daemon still listens at the place to which a connection was made.

The daemon's supervisor holds all listening sockets, and replaces the workers behind them. So a Unix
socket that refuses a connection, or that is not there any more, means that the daemon has ended. A
tcp port tells less, as a tunnel that drops refuses connections until it is up again.
"""

from __future__ import annotations

import errno
import math
import select
import socket
from typing import Any

_LOOK_SECONDS = 1.0  # between two looks
_TCP_WAIT_MS = 200  # a port of the own machine, or of a tunnel, refuses at once


class Listening:
    """Looks now and then, while replies are missing, whether somebody listens.

    Thread rule: one thread at a time.

    Args:
        address: "door://NAME" of a local door, "ipc://PATH" or "tcp://HOST:PORT".

    Attributes:
        gone_since: time.monotonic() of the look that found nobody; math.inf while somebody listens,
            and always for tcp.
    """

    def __init__(self, address: str) -> None:
        self.gone_since = math.inf
        self._kind, _, self._place = address.partition("://")
        self._next_look = 0.0

    def look(self, now: float) -> None:
        """Connects to a Unix socket and hangs up, at most once a second."""
        if self._kind == "tcp" or now < self._next_look:
            return
        self._next_look = now + _LOOK_SECONDS
        if not self.is_refused():
            self.gone_since = math.inf
        elif self.gone_since == math.inf:
            self.gone_since = now

    def is_refused(self) -> bool:
        """Whether nobody listens now. False where that cannot be found out within 0.2 s."""
        if self._kind == "door":
            return _refuses(socket.AF_UNIX, socket.SOCK_SEQPACKET, "\0" + self._place)
        if self._kind == "ipc":
            path = self._place  # ZeroMQ writes the name of a socket without a file as @NAME
            path = "\0" + path[1:] if path.startswith("@") else path
            return _refuses(socket.AF_UNIX, socket.SOCK_STREAM, path)
        host, _, port = self._place.rpartition(":")
        if not port.isdigit():
            return False
        return _refuses(socket.AF_INET, socket.SOCK_STREAM, (host, int(port)))


def _refuses(family: int, kind: int, place: Any) -> bool:
    try:
        with socket.socket(family, kind) as probe:
            probe.setblocking(False)
            result = probe.connect_ex(place)
            if result == errno.EINPROGRESS:  # of tcp alone
                poll = select.poll()
                poll.register(probe, select.POLLOUT)
                poll.poll(_TCP_WAIT_MS)
                result = probe.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
    except TimeoutError:
        raise  # nothing above times out: a signal handler raised it
    except (OSError, ValueError, OverflowError):  # no descriptor; no name of a host; no port
        return False
    return result in (errno.ECONNREFUSED, errno.ENOENT)
