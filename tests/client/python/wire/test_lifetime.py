"""Sessions, sockets and threads that no program closed are closed by collection and at its end."""

from __future__ import annotations

import errno
import gc
import os
import subprocess
import sys
import warnings
from pathlib import Path

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
import zmq
from b4mrl import errors
from b4mrl.wire import sockets
from b4mrl.wire.connection import Connection

from conftest import in_a_child
from interrupting import interrupt
from waiting import await_true, descriptor_count

PROGRAM = """
import multiprocessing, sys, threading
import b4mrl, gymnasium, numpy
from b4mrl.wire.sockets import open_link
from gymnasium.vector import AsyncVectorEnv

endpoint, kind = sys.argv[1:]

def make():
    return gymnasium.make("b4mrl:b4mrl/HalfCheetah-v0", endpoint=endpoint)

def step_for_ever(env, first):
    while True:
        env.step(numpy.zeros(6))
        first.set()

if __name__ == "__main__":
    if kind in ("fork", "spawn"):
        vec = AsyncVectorEnv([make] * 2, context=kind)
        vec.reset()
    else:
        env = make()
        env.reset()
        vec = b4mrl.connect(endpoint).make_vec("Hopper", 2)
        vec.reset()
        vec.send(numpy.zeros((2, 3)))
        other = b4mrl.connect(endpoint)
        other.query("HalfCheetah", numpy.zeros((2, 17)), numpy.zeros((2, 6)))
    if kind == "raises":
        raise SystemExit(3)
    if kind == "gives":  # an environment to a child, which closes nothing either
        child = multiprocessing.get_context("forkserver").Process(target=env.reset)
        child.start()
        child.join()
        raise SystemExit(child.exitcode)
    if kind == "drops":  # what Ctrl-C leaves of links that nobody has yet
        for _ in range(300):
            open_link(endpoint)
        b4mrl.connect(endpoint, deadline_ms=60_000)
    if kind == "thread":
        first = threading.Event()
        threading.Thread(target=step_for_ever, args=(env, first), daemon=True).start()
        first.wait()
"""


def run(endpoint: str, kind: str) -> subprocess.CompletedProcess[str]:
    # On a busy machine it may be warned of a relay, which is no matter of these tests.
    options = ["-W", "ignore", "-W", "default::ResourceWarning"]
    command = [sys.executable, *options, "-c", PROGRAM, endpoint, kind]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


@pytest.fixture
def own_client() -> b4mrl.Client:
    """Of a daemon whose sessions are all of one test."""
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        yield client


@pytest.mark.parametrize(
    ("kind", "status"), [("ends", 0), ("raises", 3), ("fork", 0), ("gives", 0)]
)
def test_a_program_that_closes_nothing_leaves_no_session(
    own_client: b4mrl.Client, kind: str, status: int
) -> None:
    done = run(own_client.endpoint, kind)
    assert (done.returncode, done.stderr) == (status, "")
    assert await_true(lambda: own_client.server_status().session_count == 0)


def test_links_that_are_dropped_stop_no_other_one(endpoint: str) -> None:
    assert run(endpoint, "drops").returncode == 0


@pytest.mark.parametrize(
    ("place", "when"),
    [
        ("b4mrl.opening.spec_of", "after"),
        ("b4mrl.wire.routes.Routes.reach", "after"),
        ("b4mrl.wire.session.Session.__init__", "before"),
        ("b4mrl.wire.session.Session.__init__", "after"),
    ],
)
def test_an_opening_that_ctrl_c_ends_leaves_no_session(
    own_client: b4mrl.Client, place: str, when: str
) -> None:
    interrupt(lambda: own_client.make("Hopper"), place, when)
    gc.collect()
    assert await_true(lambda: own_client.server_status().session_count == 0)


def test_ctrl_c_at_its_start_leaves_no_daemon() -> None:
    def children() -> list[str]:
        threads = Path("/proc/self/task").glob("*/children")
        return [child for thread in threads for child in thread.read_text().split()]

    before = children()
    interrupt(lambda: b4mrl.serve(tcp=True), "threading.Thread.start", "after")
    assert await_true(lambda: set(children()) <= set(before))


def test_a_thread_that_steps_on_does_not_disturb_the_end(own_client: b4mrl.Client) -> None:
    assert run(own_client.endpoint, "thread").returncode == 0
    # The thread's own session is left to the lease; the others are given back.
    assert await_true(lambda: own_client.server_status().session_count <= 1)


def test_what_is_collected_leaves_nothing_behind(own_client: b4mrl.Client) -> None:
    def use() -> None:
        client = b4mrl.connect(own_client.endpoint)
        env = client.make("HalfCheetah")
        env.reset()
        vec = client.make_vec("Hopper", 2)
        vec.reset()
        vec.send(np.zeros((2, 3)))
        client.query("HalfCheetah", np.zeros((2, 17)), np.zeros((2, 6)))

    use()  # ZeroMQ's own threads and descriptors stay
    assert await_true(lambda: own_client.server_status().session_count == 0)
    descriptors, threads = descriptor_count(), len(os.listdir("/proc/self/task"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for _ in range(5):
            use()
        gc.collect()
    assert [str(w.message) for w in caught if w.category is ResourceWarning] == []
    assert await_true(lambda: own_client.server_status().session_count == 0)
    assert await_true(lambda: descriptor_count() <= descriptors)
    assert await_true(lambda: len(os.listdir("/proc/self/task")) <= threads)


def test_a_forked_child_is_warned_of_no_socket_of_its_parents(client: b4mrl.Client) -> None:
    client.environments()

    def resource_warnings() -> list[str]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            client.environments()  # connects anew
            gc.collect()
        return [str(w.message) for w in caught if w.category is ResourceWarning]

    assert in_a_child(resource_warnings) == []


def test_gymnasiums_makers_leave_no_socket_open(endpoint: str) -> None:
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        gym.make("b4mrl:b4mrl/HalfCheetah-v0", endpoint=endpoint).close()
        gym.make_vec("b4mrl:b4mrl/HalfCheetah-v0", num_envs=2, endpoint=endpoint).close()
        gc.collect()
    assert [str(w.message) for w in caught if w.category is ResourceWarning] == []


def test_monitors_have_names_that_nobody_else_takes(endpoint: str) -> None:
    context = sockets._context_of(os.getpid())
    taken = []
    for number in range(256):  # pyzmq's name is the number of the descriptor
        taken.append(context.socket(zmq.PAIR))
        taken[-1].bind(f"inproc://monitor.s-{number}")
    try:
        b4mrl.connect(endpoint).close()
    finally:
        for socket in taken:
            socket.close()


@pytest.mark.parametrize("method", ["socket", "monitor"])
def test_no_more_sockets_is_an_error_of_ours(monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    def refuse(*_: object) -> None:
        raise zmq.ZMQError(errno.EMFILE)

    monkeypatch.setattr(zmq.Context if method == "socket" else zmq.Socket, method, refuse)
    with pytest.raises(errors.UnavailableError, match="tcp://127.0.0.1:1.*ulimit"):
        Connection("tcp://127.0.0.1:1")
