"""A signal handler that closes an environment in the middle of a call, and a fork in one."""

from __future__ import annotations

import os
import pkgutil
import random
import signal
import subprocess
import sys
import threading
from collections.abc import Callable

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.wire.connection import Connection

from conftest import in_a_child
from equality import assert_same

CLOSED = "^the environment is closed$"

# Where the handler comes: a function of the client, and whether before or after it has done its
# work.
EVERYWHERE = [
    ("b4mrl.wire.connection.Connection.send", "before"),
    ("b4mrl.wire.connection.Connection._transmit", "before"),
    ("b4mrl.wire.connection.Connection._transmit", "after"),
    ("b4mrl.wire.connection.Connection._pump", "before"),
    ("b4mrl.wire.connection.Connection._read", "before"),
    ("b4mrl.wire.connection.Connection._read", "after"),
    ("b4mrl.wire.connection.Connection._next_wake", "before"),
    ("b4mrl.wire.connection.Connection._next_wake", "after"),
    ("b4mrl.wire.connection.Connection._accept", "before"),
]
OF_SOCKETS = [
    ("zmq.Socket.send", "before"),
    ("zmq.Socket.send", "after"),
    ("zmq.Socket.recv", "before"),
]
OF_DOORS = [
    ("b4mrl.wire.ring.RingWriter.push", "before"),
    ("b4mrl.wire.ring.RingWriter.write", "after"),
    ("b4mrl.wire.ring.RingReader.publish", "before"),
    ("b4mrl.wire.ring.RingReader.has_bytes", "before"),
    ("b4mrl.wire.ring.RingReader.take", "before"),
    ("b4mrl.wire.door.Door._wake", "before"),
    ("b4mrl.wire.door.Door._sleep", "before"),
    ("b4mrl.wire.spinning.Spinner.learn", "before"),
]


def use_sockets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("b4mrl.wire.routes.open_door", lambda name, wait_ms: None)


def with_handler(
    place: str, when: str, handler: Callable[[], object], monkeypatch: pytest.MonkeyPatch
) -> list[str]:
    """Has `handler` called once, at that place; returns where it was called."""
    original = pkgutil.resolve_name(place)
    calls: list[str] = []

    def arrive(moment: str) -> None:
        if moment == when and not calls:
            calls.append(place)
            handler()

    def interrupted(*arguments: object, **options: object) -> object:
        arrive("before")
        result = original(*arguments, **options)
        arrive("after")
        return result

    monkeypatch.setattr(place, interrupted)
    return calls


@pytest.mark.parametrize("call", ["step", "get_state"])
@pytest.mark.parametrize(
    ("transport", "place", "when"),
    [
        *(("tcp", *each) for each in EVERYWHERE + OF_SOCKETS),
        *(("door", *each) for each in EVERYWHERE + OF_DOORS),
    ],
)
def test_an_environment_that_is_closed_in_the_middle_of_a_call_says_so(
    client: b4mrl.Client,
    monkeypatch: pytest.MonkeyPatch,
    transport: str,
    place: str,
    when: str,
    call: str,
) -> None:
    if transport == "tcp":
        use_sockets(monkeypatch)
    env = client.make("Hopper")
    env.reset(seed=1)
    assert env.transport == transport
    monkeypatch.setattr("b4mrl.wire.spinning.Spinner.spin", lambda self, watch: False)  # it sleeps
    calls = with_handler(place, when, env.close, monkeypatch)
    with pytest.raises(errors.FailedPreconditionError, match=CLOSED):
        for _ in range(1000):  # a reply may be there before the door sleeps
            env.step(np.zeros(3)) if call == "step" else env.get_state()
    assert calls == [place]
    with pytest.raises(errors.FailedPreconditionError, match=CLOSED):
        env.reset()


@pytest.mark.parametrize("transport", ["door", "tcp"])
def test_a_handler_may_close_an_environment_at_any_moment(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch, transport: str
) -> None:
    if transport == "tcp":
        use_sockets(monkeypatch)
    draws = random.Random(5)
    before = signal.signal(signal.SIGALRM, lambda *_: env.close())
    try:
        for _ in range(40):
            env = client.make("Hopper")
            env.reset(seed=1)
            signal.setitimer(signal.ITIMER_REAL, draws.uniform(20e-6, 1e-3))
            with pytest.raises(errors.FailedPreconditionError, match=CLOSED):
                while True:
                    env.step(np.zeros(3))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def test_a_door_that_was_closed_in_the_middle_of_a_call_makes_no_new_connection(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = client.make("Hopper")
    env.reset(seed=1)
    door = env.session._connection._link
    calls = with_handler("b4mrl.wire.door._is_readable", "before", door.close, monkeypatch)
    door.receive(1)
    assert calls and door._asked is None and not door.is_open
    env.close()


def test_a_handler_may_ring_while_the_call_under_it_does(client: b4mrl.Client) -> None:
    class Fence:
        lock, is_first = threading.Lock(), True

        def acquire(self, is_waited_for: bool) -> bool:
            is_taken = self.lock.acquire(is_waited_for)
            if self.is_first:
                self.is_first = False
                door._wake(door._memory, 1)  # in the handler
            return is_taken

        def release(self) -> None:
            self.lock.release()

    with client.make("Hopper") as env, client.make("Hopper") as twin:
        door = env.session._connection._link
        door._fence = Fence()
        assert_same(env.reset(seed=1), twin.reset(seed=1))
        door._fence.acquire(False)  # and then comes Ctrl-C
        assert_same(env.step(np.zeros(3)), twin.step(np.zeros(3)))
        assert door._fence.acquire(False)
        door._fence.release()


def test_a_child_that_was_forked_while_another_thread_was_in_a_call_may_close_its_copy(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_inside, may_go_on = threading.Event(), threading.Event()
    read = Connection._read

    def slow_read(connection: Connection) -> object:
        is_inside.set()
        may_go_on.wait(60)
        return read(connection)

    with client.make("Hopper") as env:
        env.reset(seed=1)
        monkeypatch.setattr(Connection, "_read", slow_read)
        results: list[object] = []
        thread = threading.Thread(target=lambda: results.append(env.step(np.zeros(3))))
        thread.start()
        assert is_inside.wait(60)

        def refuse_and_close() -> bool:
            with pytest.raises(errors.FailedPreconditionError, match="before a fork"):
                env.step(np.zeros(3))
            env.close()
            with pytest.raises(errors.FailedPreconditionError, match=CLOSED):
                env.step(np.zeros(3))
            return True

        assert in_a_child(refuse_and_close)
        may_go_on.set()
        thread.join()
        assert len(results) == 1
        env.step(np.zeros(3))  # the child has closed nothing of its parent's


def test_a_forked_child_asks_for_itself_what_its_parent_has_sent(client: b4mrl.Client) -> None:
    rows = np.full((3, 17), 0.1), np.full((3, 6), 0.5)
    wanted = client.query("HalfCheetah", *rows, "obs-noise=0.1", draw=5)
    pending = client.query_async("HalfCheetah", *rows, "obs-noise=0.1", draw=5)

    def has_the_answer() -> bool:
        return bool(np.array_equal(pending.result()[0], wanted[0]))

    assert in_a_child(has_the_answer)
    assert has_the_answer()


def test_a_connection_may_be_closed_while_another_thread_is_in_a_call() -> None:
    """Else ZeroMQ ends the program: a thread would read a socket that is gone."""
    with b4mrl.serve(workers=1) as endpoint:
        for _ in range(5):
            client = b4mrl.connect(endpoint)
            begun, failures = threading.Event(), []

            def ask(client: b4mrl.Client, begun: threading.Event, failures: list) -> None:
                try:
                    while True:
                        client.server_status()
                        begun.set()
                except errors.FailedPreconditionError as error:
                    failures.append(str(error))

            asking = threading.Thread(target=ask, args=(client, begun, failures))
            asking.start()
            assert begun.wait(60)
            client.close()
            asking.join(60)
            assert failures == ["the connection is closed; make a new one"]


def test_a_program_may_end_while_a_daemon_thread_is_in_a_call() -> None:
    program = """
import threading, b4mrl, numpy
vec = b4mrl.connect({endpoint!r}).make_vec("HalfCheetah", 64)
vec.reset()
vec.send(numpy.zeros((64, 6)))
threading.Thread(target=vec.recv, daemon=True).start()
"""
    with b4mrl.serve(workers=1, arguments=["--no-door"]) as endpoint:
        for _ in range(4):
            done = subprocess.run(
                [sys.executable, "-c", program.format(endpoint=endpoint)],
                capture_output=True,
                text=True,
                timeout=60,
            )
            assert done.returncode == 0, done.stderr
