"""Servers that do what a test says, behind a socket of ZeroMQ or behind a local door."""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import mmap
import os
import select
import socket
import struct
import threading
from collections.abc import Callable

import zmq
from b4mrl.wire.messages import Reply, Request
from b4mrl.wire.ring import BrokenRingError, Positions, RingReader, RingWriter

Answer = Callable[[Request, int], list[Reply]]  # from a request and the number of requests so far

RING_BYTES = 64 * 1024
_LONGEST_SLEEP_MS = 100
_numbers = itertools.count()


class SocketServer:
    """Answers each request with the messages that `answer` returns.

    Args:
        place: a port of tcp, or the path of an ipc socket; 0: any free port.
    """

    def __init__(self, answer: Answer, place: int | str = 0) -> None:
        self._answer = answer
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._socket.linger = 0
        self.place = place or self._socket.bind_to_random_port("tcp://127.0.0.1")
        is_path = isinstance(place, str)
        self.address = f"ipc://{place}" if is_path else f"tcp://127.0.0.1:{self.place}"
        if place:
            self._socket.bind(self.address)
        self.requests: list[Request] = []
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stopping.is_set():
            if not self._socket.poll(5):
                continue
            sender, envelope, *_ = self._socket.recv_multipart()
            self.requests.append(Request.FromString(envelope))
            for reply in self._answer(self.requests[-1], len(self.requests)):
                self._socket.send_multipart([sender, reply.SerializeToString()])

    def stop(self) -> None:
        self._stopping.set()
        self._thread.join()
        self._context.destroy(linger=0)


def listen() -> tuple[str, socket.socket]:
    """A door's name and listening socket, as the supervisor has them."""
    name = f"b4mrl-test-{os.getpid()}-{next(_numbers)}"
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind("\0" + name)
    listener.listen(8)
    return name, listener


def make_memory(seals: int = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL) -> int:
    """The descriptor of the memory of a connection."""
    descriptor = os.memfd_create("door", os.MFD_ALLOW_SEALING | os.MFD_CLOEXEC)
    os.ftruncate(descriptor, 4096 + 2 * RING_BYTES)
    if seals:
        fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
    return descriptor


def greeting(
    magic: int = 0x44523442,
    version: int = 1,
    up_bytes: int = RING_BYTES,
    down_bytes: int = RING_BYTES,
    spin_us: int = 100,
) -> bytes:
    return struct.pack("<5I12x", magic, version, up_bytes, down_bytes, spin_us)


class Guest:
    """The worker's side of one connection."""

    def __init__(self, link: socket.socket) -> None:
        self.link = link
        descriptor = make_memory()
        self.memory = memoryview(mmap.mmap(descriptor, 4096 + 2 * RING_BYTES))
        self.words, self.sleeps = self.memory.cast("Q"), self.memory.cast("I")
        middle = 4096 + RING_BYTES
        self.reader = RingReader(Positions(self.words, 8, 16), self.memory[4096:middle])
        self.writer = RingWriter(Positions(self.words, 24, 32), self.memory[middle:])
        with contextlib.suppress(OSError):  # the client may have gone
            socket.send_fds(link, [greeting()], [descriptor])
        os.close(descriptor)

    def has_left(self) -> bool:
        """Whether the client's end is closed; reads a bell."""
        try:
            return not self.link.recv(64)
        except ConnectionError:
            return True

    def wake(self, reason: int) -> None:
        with threading.Lock():  # a fence
            pass
        if self.sleeps[96] & reason:
            self.sleeps[96] = 0
            with contextlib.suppress(OSError):
                self.link.send(b"\0", socket.MSG_DONTWAIT)


class DoorServer:
    """As SocketServer, for clients that come through a door.

    Attributes:
        lost_bells: how often it slept to the end although bytes had come.
    """

    def __init__(self, answer: Answer, place: tuple[str, socket.socket] | None = None) -> None:
        self._answer = answer
        self.place = place or listen()
        self.name, self._listener = self.place
        self.address = f"ipc://@{self.name}"  # where nobody listens
        self.requests: list[Request] = []
        self.guests: list[Guest] = []
        self.lost_bells = 0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stopping.is_set():
            self._sleep()
            for guest in list(self.guests):
                try:
                    self._serve(guest)
                except BrokenRingError:
                    self._part_with(guest)
        for guest in list(self.guests):
            self._part_with(guest)

    def _sleep(self) -> None:
        if any(guest.reader.has_bytes() for guest in self.guests):
            return
        for guest in self.guests:
            guest.sleeps[80] = 3 if guest.writer.queued else 1
        with threading.Lock():  # a fence
            pass
        if not any(guest.reader.has_bytes() for guest in self.guests):
            poll = select.poll()
            for waited in (self._listener, *(guest.link for guest in self.guests)):
                poll.register(waited, select.POLLIN)
            ready = {descriptor for descriptor, _ in poll.poll(_LONGEST_SLEEP_MS)}
            if not ready:
                self.lost_bells += sum(guest.reader.has_bytes() for guest in self.guests)
            if self._listener.fileno() in ready:
                self.guests.append(Guest(self._listener.accept()[0]))
            for guest in list(self.guests):
                if guest.link.fileno() in ready and guest.has_left():
                    self._part_with(guest)
        for guest in self.guests:
            guest.sleeps[80] = 0

    def _serve(self, guest: Guest) -> None:
        while guest.reader.has_bytes():
            message = guest.reader.take()
            guest.wake(2)
            if message is not None:
                self.requests.append(Request.FromString(message[0]))
                for reply in self._answer(self.requests[-1], len(self.requests)):
                    guest.writer.push(reply.SerializeToString(), message[1])
        if guest.writer.write():
            guest.wake(1)

    def _part_with(self, guest: Guest) -> None:
        guest.link.close()
        if guest in self.guests:
            self.guests.remove(guest)

    def stop(self) -> None:
        """Ends as a worker that dies: the listening socket stays open."""
        self._stopping.set()
        self._thread.join()
