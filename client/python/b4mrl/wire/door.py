"""The local door: a link through shared memory, to a worker on the same machine.

CPython on x86-64 Linux alone has it: there, a number of a memoryview is read and written by one
instruction.

The daemon listens on a Unix socket. A client connects, and the worker makes the connection's memory
and sends its greeting with the memory's descriptor. From then on messages travel in two rings in
that memory (b4mrl.wire.ring), one in each direction. The socket carries bells, single bytes that
wake a sleeping peer, and its end says that the peer has died: the supervisor holds the listening
socket, so the next connection is to the worker's replacement, with new memory.

A side that falls asleep says for what in its word of the memory, looks once more, and sleeps. The
other side publishes or takes bytes, looks at the word, and if it was waited for, clears the word
and rings. Between the two steps of each side stands a fence, so at least one sees what the other
has written. A bell that is lost all the same costs LONGEST_BLOCK_MS.

PROTOCOL.md, section 13, has the layout.
"""

from __future__ import annotations

import contextlib
import errno
import math
import mmap
import os
import platform
import select
import socket
import struct
import sys
import threading
import time

from b4mrl.wire import limits
from b4mrl.wire.link import LONGEST_BLOCK_MS, Message
from b4mrl.wire.ring import BrokenRingError, Positions, RingReader, RingWriter
from b4mrl.wire.spinning import Spinner

_GREETING = struct.Struct("<5I12x")  # magic, version, bytes of the rings up and down, spin_us
_MAGIC, _VERSION = 0x44523442, 1
_MEMORY_START = 4096  # of the ring up; the ring down follows

# Words of 64 bits: up.head, up.tail, down.head, down.tail. Words of 32 bits: who sleeps for what.
_UP, _DOWN = (8, 16), (24, 32)
_WORKER_SLEEPS, _CLIENT_SLEEPS = 80, 96
_FOR_BYTES, _FOR_SPACE = 1, 2

_MOST_NAME_BYTES = 107  # of a socket without a file
_MOST_REFUSALS = 3
_BLOCK_TIME = struct.pack("ll", 0, LONGEST_BLOCK_MS * 1000)  # a timeval

_LINGER_LOOK = 2e-4  # seconds between two looks whether the last messages were read


class _Memory:
    """The memory of one connection, with its socket and this side's ends of its rings."""

    def __init__(
        self, link: socket.socket, descriptor: int, up_bytes: int, down_bytes: int
    ) -> None:
        self.link = link
        mapped = memoryview(mmap.mmap(descriptor, _MEMORY_START + up_bytes + down_bytes))
        words = mapped.cast("Q")
        down = _MEMORY_START + up_bytes
        self.sleeps = mapped.cast("I")
        self.writer = RingWriter(Positions(words, *_UP), mapped[_MEMORY_START:down])
        self.reader = RingReader(Positions(words, *_DOWN), mapped[down:])


class Door:
    """A Link through the door of that name; made by open_door.

    Messages that are sent before the greeting are queued.
    """

    transport = "door"

    def __init__(self, name: str) -> None:
        self.address = f"door://{name}"
        self.process_id = os.getpid()
        self._name = name
        self._memory: _Memory | None = None
        self._asked: socket.socket | None = None  # a connection whose greeting comes later
        self._asked_at = 0.0  # when that connection was made
        self._queue: list[Message] = []  # until its greeting
        self._handshakes = 0
        self._refusals = 0  # since the last greeting
        self._spinner = Spinner(0.0)
        self._is_closed = False  # perhaps by a signal handler in the middle of a call
        self._fence = threading.Lock()

    @property
    def is_open(self) -> bool:
        """Whether there is a connection whose greeting has come."""
        return self._memory is not None

    @property
    def is_refused(self) -> bool:
        """Of Link: nobody listens, or several connections in a row were ended by the daemon."""
        return self._refusals >= _MOST_REFUSALS

    def send(self, envelope: bytes, payload: bytearray) -> bool:
        """Of Link. A message that is longer than the ring is sent on in later calls.

        Waits for LONGEST_BLOCK_MS at most, if the worker has not yet read what came before.
        """
        memory = self._memory
        queued = len(self._queue) if memory is None else memory.writer.queued
        if queued >= limits.HIGH_WATER_MARK:
            return False
        if memory is None:
            self._queue.append((envelope, payload))
            return True
        memory.writer.push(envelope, payload)
        finish = 0.0
        try:
            while self._write(memory):
                now = time.monotonic()
                finish = finish or now + LONGEST_BLOCK_MS / 1000
                if now >= finish or self._memory is not memory:
                    break
                self._sleep(memory, _FOR_SPACE, LONGEST_BLOCK_MS)
        except BrokenRingError:
            self._leave()
        return True

    def receive(self, wait_ms: int) -> Message | None:
        """Of Link; looks for a message without sleeping where one probably comes soon."""
        memory, message = self._memory, None
        if memory is not None:
            try:
                if memory.reader.has_bytes() or self._await_bytes(memory, wait_ms):
                    message = memory.reader.take()
                    self._wake(memory, _FOR_SPACE)
            except BrokenRingError:
                self._leave()
        if self._memory is None:
            # At once, so that no request is given up because its caller was away when the worker
            # was replaced.
            self.connect(min(wait_ms, LONGEST_BLOCK_MS))
        return message

    def take_handshakes(self) -> int:
        """Of Link."""
        count, self._handshakes = self._handshakes, 0
        return count

    def await_handshake(self, wait_ms: int) -> None:
        """Of Link."""
        if self._memory is None:
            self.connect(wait_ms)

    def close(self, linger_ms: int = 0) -> None:
        """Of Link; waits until the worker has read the queued messages, at most `linger_ms`."""
        self._is_closed = True
        memory = self._memory
        try:
            if memory is not None and self.process_id == os.getpid():
                finish = time.monotonic() + linger_ms / 1000
                while memory.writer.is_unread() and time.monotonic() < finish:
                    self._write(memory)
                    time.sleep(_LINGER_LOOK)
        except BrokenRingError:
            pass  # the worker reads no more
        finally:
            self._leave()

    def connect(self, wait_ms: int) -> None:
        """Connects, or goes on connecting: waits for the greeting, at most `wait_ms`."""
        link = self._asked
        if link is None:
            link = None if self._is_closed else self._ask()
            if link is None:
                return
            self._queue.clear()  # the handshake has all requests sent again
            self._handshakes += 1
            self._asked_at = time.monotonic()
            self._asked = link
        is_greeted = _is_readable(link, wait_ms)
        if not is_greeted and time.monotonic() < self._asked_at + limits.HANDSHAKE_MS / 1000:
            return
        # If Ctrl-C comes after this line, the next call makes a new connection.
        self._asked = None
        memory = self._greet(link) if is_greeted else None
        if memory is None:
            self._refusals += 1
            self._hang_up(link)
            return
        self._refusals = 0
        for message in self._queue:
            memory.writer.push(*message)
        self._memory = memory
        self._queue.clear()
        if self._is_closed:  # since this call has begun
            self._leave()
            return
        with contextlib.suppress(BrokenRingError):  # the next call finds that again
            self._write(memory)

    def _ask(self) -> socket.socket | None:
        """A connection, whose greeting may come later; None if there is none to have."""
        link = None
        if len(self._name.encode()) > _MOST_NAME_BYTES:
            self._refusals = _MOST_REFUSALS
            return None
        try:
            link = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            link.setblocking(False)
            link.connect("\0" + self._name)  # a name without a file
            link.setblocking(True)
            link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _BLOCK_TIME)
            if _is_trusted(link):
                return link
            self._refusals = _MOST_REFUSALS
        except OSError as error:
            if error.errno is None:  # a signal handler raised it
                raise
            too_many_wait = isinstance(error, BlockingIOError)
            self._refusals = self._refusals + 1 if too_many_wait else _MOST_REFUSALS
        if link is not None:
            link.close()
        return None

    def _greet(self, link: socket.socket) -> _Memory | None:
        """The memory that a greeting comes with; None if it is not what this client speaks."""
        descriptors: list[int] = []
        try:
            greeting, descriptors, *_ = socket.recv_fds(
                link, _GREETING.size + 1, 1, socket.MSG_CMSG_CLOEXEC
            )
            if len(greeting) != _GREETING.size or len(descriptors) != 1:
                return None
            magic, version, up, down, spin_us = _GREETING.unpack(greeting)
            is_known = (magic, version) == (_MAGIC, _VERSION)
            if not is_known or not _is_ring(up) or not _is_ring(down):
                return None
            is_whole = os.fstat(descriptors[0]).st_size == _MEMORY_START + up + down
            if not is_whole or _can_shrink(descriptors[0]):
                return None
            self._spinner = Spinner(min(spin_us, limits.MAX_SPIN_US) / 1e6)
            return _Memory(link, descriptors[0], up, down)
        except TimeoutError:
            raise  # no call above times out: a signal handler raised it
        except OSError:
            return None
        finally:
            for descriptor in descriptors:
                os.close(descriptor)

    def _leave(self) -> None:
        """Ends the connection; messages in its memory are lost."""
        memory, self._memory = self._memory, None
        asked, self._asked = self._asked, None
        for link in (memory.link if memory else None, asked):
            if link is not None:
                self._hang_up(link)

    def _hang_up(self, link: socket.socket) -> None:
        if self.process_id == os.getpid():
            # A forked child may have a copy of the socket, which would keep the connection.
            with contextlib.suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)
        link.close()

    def _write(self, memory: _Memory) -> bool:
        """Puts queued messages into the ring; whether some did not fit. Raises BrokenRingError."""
        if memory.writer.write():
            self._wake(memory, _FOR_BYTES)
        return memory.writer.queued > 0

    def _wake(self, memory: _Memory, reason: int) -> None:
        """Wakes the worker if it sleeps for that reason; called when the reason has ended."""
        self._order_memory()
        if not memory.sleeps[_WORKER_SLEEPS] & reason or self._memory is not memory:
            return
        memory.sleeps[_WORKER_SLEEPS] = 0
        try:
            memory.link.send(b"\0", socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except OSError as error:
            # Bells enough, or nobody there, or a signal handler has closed the link. What a handler
            # raises has no number.
            is_known = isinstance(error, BlockingIOError | ConnectionError)
            if error.errno is None or not (is_known or error.errno == errno.EBADF):
                raise

    def _order_memory(self) -> None:
        """Orders the writes before it and the reads behind it, as a fence does.

        A lock does that when it is taken. It is not waited for: one that Ctrl-C has left locked, or
        that the call holds into which a signal handler came, is given up for a new one.
        """
        fence = self._fence
        if not fence.acquire(False):
            self._fence = fence = threading.Lock()
            fence.acquire(False)
        fence.release()

    def _await_bytes(self, memory: _Memory, wait_ms: int) -> bool:
        """Waits until bytes are here, at most `wait_ms` or LONGEST_BLOCK_MS; whether they are."""
        begin = time.perf_counter()
        finish = begin + min(wait_ms, LONGEST_BLOCK_MS) / 1000
        reader = memory.reader
        while True:
            is_writing = memory.writer.queued > 0 and self._write(memory)
            if wait_ms > 0 and not is_writing and self._spinner.spin(reader.watch):
                break
            self._sleep(memory, _FOR_BYTES | (_FOR_SPACE if is_writing else 0), wait_ms)
            if reader.has_bytes() or self._memory is not memory or time.perf_counter() >= finish:
                break
        if wait_ms > 0:
            self._spinner.learn(time.perf_counter() - begin)
        return reader.has_bytes()

    def _sleep(self, memory: _Memory, reasons: int, wait_ms: int) -> None:
        """Sleeps until the worker rings for a reason, at most `wait_ms` or LONGEST_BLOCK_MS."""
        link, reader, sleeps = memory.link, memory.reader, memory.sleeps
        reader.publish()
        sleeps[_CLIENT_SLEEPS] = reasons
        self._order_memory()
        try:
            if reasons & _FOR_BYTES and reader.has_bytes():
                return
            if reasons & _FOR_SPACE and memory.writer.has_space():
                return
            if wait_ms < LONGEST_BLOCK_MS and not _is_readable(link, wait_ms):
                return
            has_ended = not link.recv(64)
        except OSError as error:
            if error.errno is None:  # a signal handler raised it
                raise
            if isinstance(error, BlockingIOError):  # nobody rang
                return
            # The worker has ended, or a signal handler has closed the link.
            if not isinstance(error, ConnectionError) and error.errno != errno.EBADF:
                raise
            has_ended = True
        finally:
            sleeps[_CLIENT_SLEEPS] = 0
        if has_ended and not reader.has_bytes():  # what the worker published before is taken first
            self._leave()


def open_door(name: str, wait_ms: int) -> Door | None:
    """A link through the door `name`; None where it does not open within `wait_ms`."""
    is_cpython = sys.implementation.name == "cpython"
    if sys.platform != "linux" or platform.machine() != "x86_64" or not is_cpython:
        return None
    door = Door(name)
    finish = time.monotonic() + wait_ms / 1000
    while not door.is_open and not door.is_refused and time.monotonic() < finish:
        door.connect(math.ceil((finish - time.monotonic()) * 1000))
    if door.is_open:
        return door
    door.close()
    return None


def _is_ring(size: int) -> bool:
    """Whether a ring may have so many bytes: a power of two."""
    is_power = size & (size - 1) == 0
    return is_power and limits.MIN_RING_BYTES <= size <= limits.MAX_RING_BYTES


def _is_trusted(link: socket.socket) -> bool:
    """Whether the peer's process belongs to this user, or to root."""
    _, user, _ = struct.unpack("iII", link.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return user in (0, os.geteuid())


def _is_readable(link: socket.socket, wait_ms: int) -> bool:
    descriptor = link.fileno()
    if descriptor < 0:
        return False  # a signal handler has closed it
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(max(wait_ms, 0)))


def _can_shrink(descriptor: int) -> bool:
    """Whether the peer can still take away memory, so that reading it would end this process."""
    import fcntl  # not on Windows, where this module is imported all the same

    seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
    return fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) & seals != seals
