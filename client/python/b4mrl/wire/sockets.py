"""Links through ZeroMQ."""

from __future__ import annotations

import functools
import itertools
import os
import zmq
from zmq.utils.monitor import recv_monitor_message

from b4mrl import errors
from b4mrl.wire import limits
from b4mrl.wire.link import LONGEST_BLOCK_MS, NOISE, Message

# Numbers in the monitors' addresses. pyzmq's own choice, the socket's file descriptor, may belong
# to a new socket before the address of the closed one is free again.
_numbers = itertools.count()

# Messages that a socket holds before they are received, each of up to 64 MiB: twice the requests that
# a connection may have in flight.
_UNREAD_REPLIES = 2 * limits.MAX_REQUESTS_IN_FLIGHT

# A forked child can close none of its parent's sockets, and pyzmq warns of each that is collected
# unclosed.
_of_parents: list[zmq.Socket[bytes]] = []

# Monitors of the sockets that may still report. ZeroMQ's only thread waits, without end and for all
# sockets of the process, for a monitor that is gone, as Ctrl-C at the wrong moment would have it.
_monitors: set[zmq.Socket[bytes]] = set()

_MORE = zmq.NOBLOCK | zmq.SNDMORE


@functools.cache
def _context_of(process_id: int) -> zmq.Context[zmq.Socket[bytes]]:
    """The ZeroMQ context of this process; a forked child gets one of its own."""
    context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 65535)
    return context


class SocketLink:
    """A Link through a ZeroMQ socket, whose monitor reports every handshake; made by open_link.

    Messages that are sent before the first handshake are queued.

    Args:
        socket, monitor: owned by the link.
    """

    is_refused = False  # ZeroMQ goes on connecting

    def __init__(self, address: str, socket: zmq.Socket[bytes], monitor: zmq.Socket[bytes]) -> None:
        self.transport = address.partition("://")[0]
        self.process_id = os.getpid()
        self.address = address
        self._socket = socket
        self._monitor = monitor
        # Perhaps half a message, as an interrupt may come between two of its frames.
        self._half_sent = False
        self._half_received = False

    def send(self, envelope: bytes, payload: bytearray) -> bool:
        """Of Link; returns at once. ZeroMQ's threads send the message."""
        socket = self._socket
        try:
            if self._half_sent:
                # The next frame would count as the message's rest. With two empty frames it becomes
                # a message that the server drops.
                socket.send_multipart([b"", b""], zmq.NOBLOCK)
            self._half_sent = True
            if payload:
                socket.send(envelope, _MORE)
                socket.send(payload, zmq.NOBLOCK)
            else:
                socket.send(envelope, zmq.NOBLOCK)
            self._half_sent = False
        except zmq.Again:
            self._half_sent = False  # a queue that is full refuses a message's first frame
            return False
        except zmq.ZMQError as error:
            raise self._broken(error) from error
        return True

    def receive(self, wait_ms: int) -> Message | None:
        """Of Link; releases the interpreter's lock while it waits."""
        socket = self._socket
        try:
            if wait_ms < LONGEST_BLOCK_MS and not socket.poll(max(wait_ms, 0)):
                return None
            if self._half_received:
                self._skip_frames()
            self._half_received = True
            envelope = socket.recv(copy=False)
            payload = socket.recv(copy=False) if envelope.more else None
            has_more = payload is not None and payload.more
            if has_more:
                self._skip_frames()
            # A longer envelope may take much more, once it is parsed.
            if has_more or len(envelope.buffer) > limits.MAX_ENVELOPE_BYTES:
                message = NOISE
            elif payload is None:
                message = envelope.bytes, bytearray()
            else:
                message = envelope.bytes, bytearray(payload.buffer)
            self._half_received = False
            return message
        except zmq.Again:
            return None
        except zmq.ZMQError as error:
            raise self._broken(error) from error

    def take_handshakes(self) -> int:
        """Of Link."""
        count = 0
        try:
            while self._monitor.poll(0):
                recv_monitor_message(self._monitor)
                count += 1
        except zmq.ZMQError as error:
            raise self._broken(error) from error
        return count

    def await_handshake(self, wait_ms: int) -> None:
        """Of Link."""
        self._monitor.poll(wait_ms)

    def close(self, linger_ms: int = 0) -> None:
        """Of Link; keeps the sockets in a forked child, where ZeroMQ's threads do not run."""
        if self.process_id != os.getpid():
            _of_parents.extend((self._socket, self._monitor))
        elif not self._socket.closed:
            self._socket.disable_monitor()
            _monitors.discard(self._monitor)
            self._monitor.close(linger=0)
            self._socket.close(linger=linger_ms)

    def _skip_frames(self) -> None:
        """Receives the rest of a message of which a frame was received."""
        while self._socket.get(zmq.RCVMORE):
            self._socket.recv()

    def _broken(self, error: zmq.ZMQError) -> errors.B4mrlError:
        if self._socket.closed:  # by a signal handler in the middle of a call
            return errors.connection_closed()
        return errors.UnavailableError(f"the socket towards {self.address} failed: {error}")


def open_link(address: str) -> SocketLink:
    """A link to the server that listens on `address`; does not wait for the connection.

    InvalidArgumentError: `address` is malformed. UnavailableError: the system has no more sockets.
    """
    allowed = "allowed: tcp://HOST:PORT or ipc://PATH"
    if not isinstance(address, str):
        raise errors.InvalidArgumentError(f"address is {address!r}, {allowed}, as a str")
    if address.startswith("tcp://["):  # ZeroMQ would take it and never connect
        raise errors.InvalidArgumentError(
            f"address is {address!r}, {allowed}, where HOST is a name or an IPv4 address: daemons "
            "do not speak IPv6"
        )
    try:
        socket = _context_of(os.getpid()).socket(zmq.DEALER)
    except zmq.ZMQError as error:
        raise _no_socket(address, error) from error
    try:
        _configure(socket)
        monitor = _monitor_of(socket)
    except zmq.ZMQError as error:
        socket.close(linger=0)
        raise _no_socket(address, error) from error
    _monitors.add(monitor)  # a socket that was never connected has reported nothing
    link = SocketLink(address, socket, monitor)
    try:
        socket.connect(address)
    except (zmq.ZMQError, UnicodeEncodeError) as error:
        link.close()
        raise errors.InvalidArgumentError(f"address is {address!r} ({error}), {allowed}") from None
    return link


def _monitor_of(socket: zmq.Socket[bytes]) -> zmq.Socket[bytes]:
    """A socket that is told of each handshake.

    Without a limit: where an idle connection is made anew again and again, ZeroMQ's thread would
    wait for somebody to read of the two thousandth, and with it all sockets of the process.
    """
    place = f"inproc://b4mrl-{next(_numbers)}"
    socket.monitor(place, zmq.EVENT_HANDSHAKE_SUCCEEDED)
    monitor = _context_of(os.getpid()).socket(zmq.PAIR)
    monitor.set(zmq.LINGER, 0)
    monitor.set(zmq.RCVHWM, 0)
    monitor.connect(place)
    return monitor


def _no_socket(address: str, error: zmq.ZMQError) -> errors.B4mrlError:
    return errors.UnavailableError(
        f"the system has no socket for {address} ({error}); close clients, environments and "
        "datasets that are not used any more, or raise `ulimit -n`"
    )


def _configure(socket: zmq.Socket[bytes]) -> None:
    socket.set(zmq.LINGER, 0)
    socket.set(zmq.MAXMSGSIZE, limits.MAX_PAYLOAD_BYTES)
    socket.set(zmq.SNDHWM, limits.HIGH_WATER_MARK)
    socket.set(zmq.RCVHWM, _UNREAD_REPLIES)
    socket.set(zmq.HANDSHAKE_IVL, limits.HANDSHAKE_MS)
    socket.set(zmq.HEARTBEAT_IVL, limits.HEARTBEAT_INTERVAL_MS)
    socket.set(zmq.HEARTBEAT_TIMEOUT, limits.HEARTBEAT_TIMEOUT_MS)
    socket.set(zmq.HEARTBEAT_TTL, limits.HEARTBEAT_TTL_MS)
    socket.set(zmq.RCVTIMEO, LONGEST_BLOCK_MS)
