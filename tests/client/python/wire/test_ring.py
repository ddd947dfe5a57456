"""Rings of shared memory: what goes in comes out, whatever the sizes, and whatever the peer does."""

from __future__ import annotations

import random
import sys
from types import FrameType
from typing import Any

import pytest
from b4mrl.wire import limits, ring
from b4mrl.wire.link import Message
from b4mrl.wire.ring import BrokenRingError, Positions, RingReader, RingWriter

HEAD, TAIL = 8, 16  # words of the positions


class Pair:
    """Both ends of a new ring."""

    def __init__(self, size: int) -> None:
        memory = memoryview(bytearray(4096 + size))
        self.words, self.bytes = memory.cast("Q"), memory[4096:]
        self.writer = RingWriter(Positions(self.words, HEAD, TAIL), self.bytes)
        self.reader = RingReader(Positions(self.words, HEAD, TAIL), self.bytes)

    def carry(self, message: Message) -> Message:
        """Sends a message and takes it at the other end."""
        self.writer.push(*message)
        while True:
            self.writer.write()
            assert self.reader.has_bytes() and self.reader.watch(1)
            taken = self.reader.take()
            if taken is not None:
                assert self.writer.queued == 0 and not self.reader.has_bytes()
                return taken


def draw(draws: random.Random, longest: int) -> Message:
    return draws.randbytes(draws.randint(0, 300)), bytearray(
        draws.randbytes(int(2 ** draws.uniform(0, longest.bit_length() - 1)) - 1)
    )


@pytest.mark.parametrize("size", [64, 256, 4096])
def test_messages_of_all_sizes_come_whole_and_in_order(size: int) -> None:
    draws = random.Random(size)
    pair = Pair(size)
    sent, taken = [], []
    while len(sent) < 3000:
        for _ in range(draws.randint(0, 3)):
            sent.append(draw(draws, 4 * size))
            pair.writer.push(*sent[-1])
        for _ in range(draws.randint(0, 30)):
            pair.writer.write()
            message = pair.reader.take()
            taken += [] if message is None else [message]
    while len(taken) < len(sent):
        pair.writer.write()
        message = pair.reader.take()
        taken += [] if message is None else [message]
    assert taken == sent
    assert pair.words[HEAD] == pair.words[TAIL]


def test_a_message_may_begin_and_end_at_every_line() -> None:
    pair = Pair(1024)
    for lines in range(1, 40):
        for _ in range(20):
            message = b"e" * 10, bytearray(i % 251 for i in range(64 * lines - 26))
            assert pair.carry(message) == message


def test_a_message_as_long_as_any_comes_through_the_smallest_ring() -> None:
    pair = Pair(64 * 1024)
    payload = bytearray(random.Random(1).randbytes(limits.MAX_PAYLOAD_BYTES))
    envelope = b"e" * limits.MAX_ENVELOPE_BYTES
    assert pair.carry((envelope, payload)) == (envelope, payload)


def test_an_end_that_finds_nothing_says_so() -> None:
    pair = Pair(256)
    assert not pair.writer.write()
    assert not pair.reader.watch(10) and pair.reader.take() is None
    pair.writer.push(b"", bytearray(500))
    assert pair.writer.write() and not pair.writer.has_space() and not pair.writer.write()
    assert pair.writer.queued == 1
    assert pair.reader.take() is None and pair.writer.has_space()


@pytest.mark.parametrize("head", [1, 63, 256 + 64, 2**63, 2**64 - 64])
def test_a_writer_that_cannot_be_is_found_out(head: int) -> None:
    pair = Pair(256)
    pair.words[HEAD] = head
    with pytest.raises(BrokenRingError):
        pair.reader.take()


@pytest.mark.parametrize("tail", [1, 63, 192, 2**63, 2**64 - 256])
def test_a_reader_that_cannot_be_is_found_out(tail: int) -> None:
    pair = Pair(256)
    pair.carry((b"", bytearray(100)))
    pair.words[TAIL] = tail
    pair.writer.push(b"", bytearray(100))
    with pytest.raises(BrokenRingError):
        pair.writer.write()


@pytest.mark.parametrize(
    "sizes",
    [(limits.MAX_ENVELOPE_BYTES + 1, 0, 0), (0, limits.MAX_PAYLOAD_BYTES + 1, 0), (8, 8, 1)],
)
def test_sizes_that_no_message_has_are_found_out(sizes: tuple[int, int, int]) -> None:
    pair = Pair(256)
    ring._PREFIX.pack_into(pair.bytes, 0, *sizes)
    pair.words[HEAD] = 64
    with pytest.raises(BrokenRingError):
        pair.reader.take()


def test_an_announced_length_takes_no_memory_before_its_bytes_come() -> None:
    pair = Pair(256)
    ring._PREFIX.pack_into(pair.bytes, 0, 0, limits.MAX_PAYLOAD_BYTES, 0)
    pair.words[HEAD] = 256
    assert pair.reader.take() is None
    assert len(pair.reader._at[1]) == 256


class Interruption:
    """Raises KeyboardInterrupt before the line of ring.py that is executed as number `moment`."""

    def __init__(self, moment: int) -> None:
        self._left = moment

    def __call__(self, frame: FrameType, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename != ring.__file__:
            return None
        if event == "line":
            self._left -= 1
            if self._left == 0:
                raise KeyboardInterrupt
        return self


@pytest.mark.parametrize("moment", range(1, 900, 3))
def test_an_interrupt_at_any_line_loses_or_doubles_one_message_at_most(moment: int) -> None:
    draws = random.Random(moment)
    pair = Pair(256)
    sent = [draw(draws, 1000) for _ in range(12)]
    waiting, taken = list(sent), []
    before = sys.gettrace()
    sys.settrace(Interruption(moment))
    for _ in range(400):
        try:
            if waiting:
                pair.writer.push(*waiting.pop(0))
            pair.writer.write()
            message = pair.reader.take()
            taken += [] if message is None else [message]
            if not pair.reader.has_bytes():
                pair.reader.publish()  # as before each sleep
        except KeyboardInterrupt:
            sys.settrace(before)
    sys.settrace(before)
    missing = [message for message in sent if message not in taken]
    assert len(missing) <= 1
    for message in set(map(repr, taken)):
        first = [repr(it) for it in taken].index(message)
        del taken[first]
    assert len(taken) <= 1  # a message that came twice
    assert pair.writer.queued == 0
    assert pair.carry(sent[0]) == sent[0]


@pytest.mark.parametrize("moment", range(1, 14))
def test_a_handler_may_write_what_the_call_under_it_was_about_to_write(moment: int) -> None:
    pair, left = Pair(256), moment

    def handler(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal left
        if event == "line" and frame.f_code is RingWriter.write.__code__:
            left -= 1
            if left == 0:
                sys.settrace(before)
                pair.writer.write()
        return handler

    pair.writer.push(b"head", bytearray(b"tail"))
    before = sys.gettrace()
    sys.settrace(handler)
    try:
        pair.writer.write()
    finally:
        sys.settrace(before)
    assert left == 0
    assert pair.writer.queued == 0
    assert pair.reader.watch(1)
    assert pair.reader.take() == (b"head", bytearray(b"tail"))
