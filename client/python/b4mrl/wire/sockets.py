"""Pairs of ZeroMQ sockets: one to a server, and a monitor that reports its connections."""

from __future__ import annotations

import functools
import itertools
import os
from dataclasses import dataclass

import zmq
from zmq.utils.monitor import recv_monitor_message

from b4mrl import errors
from b4mrl.wire import limits

LONGEST_BLOCK_MS = 20  # longest wait for a message before the monitor is read

# Numbers in the monitors' addresses. pyzmq's own choice, the socket's file descriptor, may belong
# to a new socket before the address of the closed one is free again.
_numbers = itertools.count()


@functools.cache
def _context_of(process_id: int) -> zmq.Context[zmq.Socket[bytes]]:
    """The ZeroMQ context of this process; a forked child gets one of its own."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 65535)
    return context


@dataclass(frozen=True, slots=True)
class Link:
    """A socket and its monitor, which reports every handshake; closed by the owner.

    Thread rule: one thread at a time. A forked child cannot use it, and close does nothing there.
    """

    socket: zmq.Socket[bytes]
    monitor: zmq.Socket[bytes]
    process_id: int

    def close(self, linger_ms: int = 0) -> None:
        """Closes both sockets; ZeroMQ goes on sending queued messages for up to `linger_ms`."""
        if self.process_id == os.getpid() and not self.socket.closed:
            self.socket.disable_monitor()
            self.monitor.close(linger=0)
            self.socket.close(linger=linger_ms)

    def take_handshakes(self) -> int:
        """The number of handshakes since the last call."""
        count = 0
        while self.monitor.poll(0):
            recv_monitor_message(self.monitor)
            count += 1
        return count


def open_link(address: str) -> Link:
    """A link to the server that listens on `address`; does not wait for the connection.

    InvalidArgumentError: `address` is malformed. UnavailableError: the system has no more sockets.
    """
    allowed = "allowed: tcp://HOST:PORT or ipc://PATH"
    if not isinstance(address, str):
        raise errors.InvalidArgumentError(f"address is {address!r}, {allowed}, as a str")
    try:
        socket = _context_of(os.getpid()).socket(zmq.DEALER)
    except zmq.ZMQError as error:
        raise _no_socket(address, error) from error
    try:
        _configure(socket)
        monitor = socket.get_monitor_socket(
            zmq.EVENT_HANDSHAKE_SUCCEEDED, f"inproc://b4mrl-{next(_numbers)}"
        )
    except zmq.ZMQError as error:
        socket.close(linger=0)
        raise _no_socket(address, error) from error
    link = Link(socket, monitor, os.getpid())
    try:
        socket.connect(address)
    except zmq.ZMQError as error:
        link.close()
        raise errors.InvalidArgumentError(f"address is {address!r} ({error}), {allowed}") from None
    return link


def _no_socket(address: str, error: zmq.ZMQError) -> errors.B4mrlError:
    return errors.UnavailableError(
        f"the system has no socket for {address} ({error}); close clients, environments and "
        "datasets that are not used any more, or raise `ulimit -n`"
    )


def _configure(socket: zmq.Socket[bytes]) -> None:
    socket.set(zmq.LINGER, 0)
    socket.set(zmq.MAXMSGSIZE, limits.MAX_PAYLOAD_BYTES)
    socket.set(zmq.SNDHWM, limits.HIGH_WATER_MARK)
    socket.set(zmq.RCVHWM, limits.HIGH_WATER_MARK)
    socket.set(zmq.HANDSHAKE_IVL, limits.HANDSHAKE_MS)
    socket.set(zmq.HEARTBEAT_IVL, limits.HEARTBEAT_INTERVAL_MS)
    socket.set(zmq.HEARTBEAT_TIMEOUT, limits.HEARTBEAT_TIMEOUT_MS)
    socket.set(zmq.HEARTBEAT_TTL, limits.HEARTBEAT_TTL_MS)
    socket.set(zmq.RCVTIMEO, LONGEST_BLOCK_MS)
