"""The local door against the worker's own side, which is C++ and runs in a process of its own."""

from __future__ import annotations

import collections
import os
import random
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from b4mrl.wire import door as doors
from b4mrl.wire import link as links

WAIT_S = 60  # for a worker on a busy machine
LOST_S = 2  # a bell that comes later than this is lost
PAUSE_ONE_IN = 3
SHORTEST_PAUSE_S, LONGEST_PAUSE_S = 1e-7, 6e-5

pool = bytearray(random.Random(1).randbytes(1 << 16)) * 1040  # 65 MiB, of which payloads are parts


@pytest.fixture
def start() -> Iterator[Callable[..., str]]:
    """Starts workers that send all messages back; returns a worker's door."""
    program = Path(os.environ["B4MRL_SERVER"]).parent / "door_fuzz"
    if not program.exists():
        pytest.skip("door_fuzz was not built")
    workers: list[subprocess.Popen[str]] = []

    def start_worker(*options: str) -> str:
        name = f"b4mrl-python-fuzz-{os.getpid()}-{len(workers)}"
        command = [program, "echo", name, *options]
        workers.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert workers[-1].stdout is not None and workers[-1].stdout.readline() == "ready\n"
        return name

    yield start_worker
    for worker in workers:
        # It ends with its client, and with an error if one of its sleeps lost its bell.
        try:
            assert worker.wait(10) == 0
        finally:
            worker.kill()


def log_uniform(draws: random.Random, lowest: int, highest: int) -> int:
    return int(lowest * (highest / lowest) ** draws.random())


def exchange(door: doors.Door, count: int, lowest: int, highest: int, most_underway: int) -> None:
    """Sends messages of `lowest` to `highest` bytes and checks every byte that comes back."""
    draws = random.Random(2)
    underway: collections.deque[tuple[bytes, memoryview]] = collections.deque()
    view = memoryview(pool)
    sent = received = 0
    while received < count:
        most = draws.randrange(1, most_underway + 1)
        while sent < count and len(underway) < most:
            size = log_uniform(draws, lowest, highest)
            begin = draws.randrange(1 << 16)
            envelope = sent.to_bytes(8, "little") * draws.randrange(1, 20)
            underway.append((envelope, view[begin : begin + size]))
            assert door.send(envelope, bytearray(underway[-1][1]))
            sent += 1
        envelope, payload = receive(door)
        expected = underway.popleft()
        assert envelope == expected[0] and payload == expected[1], received
        received += 1
    assert door.take_handshakes() == 1


def receive(door: doors.Door) -> links.Message:
    finish = time.monotonic() + WAIT_S
    while time.monotonic() < finish:
        message = door.receive(links.LONGEST_BLOCK_MS)
        if message is not None:
            return message
    raise TimeoutError


def test_messages_of_all_sizes_come_back_from_a_worker(start, pytestconfig) -> None:
    is_long = pytestconfig.getoption("--long")
    small, large = (1_000_000, 100) if is_long else (10_000, 5)
    for arguments in ((small, 1, 1 << 16, 64), (large, 1 << 16, 1 << 26, 3)):
        door = doors.open_door(start(), WAIT_S * 1000)
        assert door is not None
        exchange(door, *arguments)
        door.close()


class PausingFence:
    """Stands for the lock that is a door's fence, with pauses before and behind it."""

    def __init__(self) -> None:
        self.draws = random.Random(3)

    def acquire(self, blocking: bool) -> None:
        self.pause()

    def release(self) -> None:
        self.pause()

    def pause(self) -> None:
        if self.draws.randrange(PAUSE_ONE_IN):
            return
        finish = time.perf_counter() + SHORTEST_PAUSE_S * (
            (LONGEST_PAUSE_S / SHORTEST_PAUSE_S) ** self.draws.random()
        )
        while time.perf_counter() < finish:
            os.sched_yield()  # a system call, so that what came before is seen by the other side


class WatchedDoor(doors.Door):
    """Counts sleeps, and those that no bell ended although what they waited for was there."""

    sleeps = lost_bells = 0

    def _sleep(self, memory, reasons, wait_ms) -> None:
        begin = time.monotonic()
        super()._sleep(memory, reasons, wait_ms)
        self.sleeps += 1
        if time.monotonic() < begin + LOST_S:
            return
        has_bytes = reasons & doors._FOR_BYTES and memory.reader.has_bytes()
        has_space = reasons & doors._FOR_SPACE and memory.writer.has_space()
        self.lost_bells += bool(has_bytes or has_space)


def test_no_bell_is_lost_between_sides_that_pause(start, monkeypatch, pytestconfig) -> None:
    monkeypatch.setattr(doors, "_BLOCK_TIME", doors.struct.pack("ll", LOST_S, 0))
    door = WatchedDoor(start("pauses"))
    door._fence = PausingFence()
    while not door.is_open:
        assert not door.is_refused
        door.connect(WAIT_S * 1000)
    rounds = 100_000 if pytestconfig.getoption("--long") else 3_000
    draws = random.Random(4)
    for part in range(rounds // 500):
        door._handshakes = 1
        # One in ten parts has messages that are longer than a ring: both ends wait for space.
        exchange(door, 500, 1, 1 << (20 if draws.randrange(10) == 0 else 8), 3)
    assert door.sleeps > rounds / 10
    assert door.lost_bells == 0
    print(f"{door.sleeps} sleeps")
    door.close()
