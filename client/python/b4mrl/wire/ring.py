"""Rings of shared memory, each of which carries messages from one process to another.

A message is a prefix of 16 bytes (the envelope's length and the payload's, 32 bits each, and 64
zero bits), the envelope, the payload, and padding to a multiple of 64 bytes. Two positions count
bytes from the ring's beginning on: up to where the writer has published, and up to where the reader
has taken. Both only grow, in multiples of 64. A message that is longer than the free space is
published in parts, as space comes.

An end trusts its own position alone: what the peer wrote is copied once and then checked. Ctrl-C
may come between any two lines here; each method then goes on where the interrupted call was. The
order of the reads and writes below is what a processor that keeps the order of writes needs
(x86-64).

Thread rule: an end belongs to one thread.
"""

from __future__ import annotations

import itertools
import struct
from collections import deque

from b4mrl.wire import limits
from b4mrl.wire.link import Message

LINE = 64  # bytes; positions are multiples of it

_PREFIX = struct.Struct("<IIQ")
_NONE = bytearray()  # of a message of which nothing was taken; stays empty


class BrokenRingError(Exception):
    """The peer wrote what no ring holds, so the ring is of no use any more."""


class Positions:
    """The two positions of a ring, in memory that both processes see.

    Args:
        words: the memory in words of 64 bits.
        head, tail: the words of the writer's position and of the reader's.
    """

    __slots__ = ("words", "head", "tail")

    def __init__(self, words: memoryview, head: int, tail: int) -> None:
        self.words = words
        self.head = head
        self.tail = tail


class RingWriter:
    """The writing end of a new ring.

    Args:
        positions: of the ring.
        ring: the ring's bytes, a power of two of them.
    """

    def __init__(self, positions: Positions, ring: memoryview) -> None:
        self._words, self._head_word = positions.words, positions.head
        self._tail_word = positions.tail
        self._ring = ring
        self._size = len(ring)
        self._head = 0  # own position
        self._begin = 0  # position at which the first queued message begins
        self._queue: deque[bytes] = deque()

    @property
    def queued(self) -> int:
        """The number of messages that are not entirely in the ring."""
        return len(self._queue)

    def is_unread(self) -> bool:
        """Whether the reader has not yet taken all messages."""
        return self.queued > 0 or bool(self._words[self._tail_word] != self._head)

    def push(self, envelope: bytes, payload: bytearray) -> None:
        """Queues a message; `write` puts it into the ring."""
        prefix = _PREFIX.pack(len(envelope), len(payload), 0)
        padding = bytes(-(len(prefix) + len(envelope) + len(payload)) % LINE)
        self._queue.append(b"".join((prefix, envelope, payload, padding)))

    def has_space(self) -> bool:
        """Whether a byte of a queued message would find room."""
        return bool(self._head - self._words[self._tail_word] != self._size)

    def write(self) -> bool:
        """Publishes what there is space for; whether there was any. Raises BrokenRingError."""
        first = self._head
        try:
            while self._queue:
                self._words[self._head_word] = self._head
                message = self._queue[0]
                written = self._head - self._begin
                if written == len(message):
                    self._begin = self._head  # before it leaves the queue: twice sent is not lost
                    self._queue.popleft()
                    continue
                used = self._head - self._words[self._tail_word]
                if not 0 <= used <= self._size or used % LINE:
                    raise BrokenRingError
                count = min(len(message) - written, self._size - used)
                if count == 0:
                    break
                self._copy(message, written, count)
                self._head += count
        except IndexError:  # a signal handler has closed the environment, and emptied the queue
            pass
        return self._head != first

    def _copy(self, message: bytes, start: int, count: int) -> None:
        """Copies bytes of a message to the own position."""
        place = self._head % self._size
        straight = min(count, self._size - place)
        if straight == len(message):
            self._ring[place : place + straight] = message
            return
        source = memoryview(message)[start : start + count]
        self._ring[place : place + straight] = source[:straight]
        self._ring[: count - straight] = source[straight:]


class RingReader:
    """The reading end of a new ring; arguments as those of RingWriter."""

    def __init__(self, positions: Positions, ring: memoryview) -> None:
        self._words, self._head_word = positions.words, positions.head
        self._tail_word = positions.tail
        self._ring = ring
        self._size = len(ring)
        # Where the next message begins, and its bytes that were taken; changed at once.
        self._at: tuple[int, bytearray] = 0, _NONE

    def has_bytes(self) -> bool:
        """Whether the writer has published bytes that were not taken."""
        begin, taken = self._at
        return bool(self._words[self._head_word] != begin + len(taken))

    def watch(self, looks: int) -> bool:
        """As has_bytes, but looks up to that many times."""
        words, word = self._words, self._head_word
        begin, taken = self._at
        tail = begin + len(taken)
        for _ in itertools.repeat(None, looks):
            if words[word] != tail:
                return True
        return False

    def publish(self) -> None:
        """Publishes the own position again, as an interrupt may have come before that in `take`."""
        begin, taken = self._at
        self._words[self._tail_word] = begin + len(taken)

    def take(self) -> Message | None:
        """Takes bytes of the next message; None until it has all. Raises BrokenRingError."""
        begin, taken = self._at
        tail = begin + len(taken)
        waiting = self._words[self._head_word] - tail
        if waiting == 0 and not taken:  # an interrupt may have come before `taken` was given
            return None
        if not 0 <= waiting <= self._size or waiting % LINE:
            raise BrokenRingError
        ring, place = self._ring, tail % self._size
        straight = self._size - place
        envelope, end, total = _sizes(taken, 0) if taken else _sizes(ring, place)
        if not taken:
            if total <= waiting and total <= straight:  # as nearly always
                first = place + _PREFIX.size
                middle = first + envelope
                message = bytes(ring[first:middle]), bytearray(ring[middle : place + end])
                self._go_on(begin + total)
                return message
            taken = bytearray()
            self._at = begin, taken
        count = min(waiting, total - len(taken))
        taken += ring[place : place + min(count, straight)]
        taken += ring[: max(count - straight, 0)]
        if len(taken) < total:
            self.publish()
            return None
        middle = _PREFIX.size + envelope
        self._go_on(begin + total)
        return bytes(taken[_PREFIX.size : middle]), taken[middle:end]

    def _go_on(self, begin: int) -> None:
        """Lets the next message begin at a position, and publishes that."""
        self._at = begin, _NONE
        self._words[self._tail_word] = begin


def _sizes(source: memoryview | bytearray, place: int) -> tuple[int, int, int]:
    """The bytes of a message's envelope, of it all without padding, and with padding."""
    envelope, payload, zero = _PREFIX.unpack_from(source, place)
    if envelope > limits.MAX_ENVELOPE_BYTES or payload > limits.MAX_PAYLOAD_BYTES or zero:
        raise BrokenRingError
    end = _PREFIX.size + envelope + payload
    return envelope, end, end + -end % LINE
