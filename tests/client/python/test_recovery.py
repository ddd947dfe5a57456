"""Workers that die, and processes that fork."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from types import SimpleNamespace

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.serve import find_server
from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv

from conftest import environment_workers, in_a_child
from equality import assert_same


def walk(vec: b4mrl.VectorEnvironment, steps: int, between=lambda step: None) -> list:
    results = [vec.reset(seed=3)]
    vec.action_space.seed(0)
    for step in range(steps):
        between(step)
        results.append(vec.step(vec.action_space.sample()))
    return results


def test_a_trajectory_does_not_notice_that_workers_die(long: bool) -> None:
    steps, every = (10_000, 50) if long else (300, 25)
    with b4mrl.serve(tcp=True, workers=2) as endpoint, b4mrl.connect(endpoint) as client:

        def kill(step: int) -> None:
            if step % every == every // 2:
                for worker in environment_workers(client):
                    os.kill(worker, signal.SIGKILL)

        options = {"autoreset_mode": "same_step", "simulator": "obs-noise=0.1", "num_envs": 16}
        with client.make_vec("HalfCheetah", **options) as calm:
            wanted, digests = walk(calm, steps), calm.digests
        with client.make_vec("HalfCheetah", **options) as disturbed:
            assert_same(walk(disturbed, steps, kill), wanted)
            np.testing.assert_array_equal(disturbed.digests, digests)
        restarts = sum(worker.restarts for worker in client.server_status().workers)
        assert restarts >= steps // every


@pytest.mark.parametrize("follows", ["the same step", "another step", "reset", "get_state"])
def test_what_got_no_answer_within_the_deadline_is_asked_for_again(follows: str) -> None:
    lost, other = np.full(6, 0.5), np.full(6, -0.5)
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with client.make("HalfCheetah") as env, client.make("HalfCheetah") as twin:
            env.reset(seed=1)
            twin.reset(seed=1)
            (worker,) = environment_workers(client)
            os.kill(worker, signal.SIGSTOP)
            env.session.deadline_ms = 100
            with pytest.raises(
                TimeoutError, match=r"step from tcp://\S+ within 0.1 s.*again"
            ) as it:
                env.step(lost)
            assert it.value.executed_unknown and it.value.recoverable
            env.session.deadline_ms = 120_000  # until a replacement is there
            wanted = twin.step(lost)
            if follows == "the same step":
                assert_same(env.step(lost), wanted)
            if follows == "another step":
                with pytest.warns(RuntimeWarning, match="outcome is dropped"):
                    assert_same(env.step(other), twin.step(other))
            if follows == "reset":
                assert_same(env.reset(), twin.reset())
            if follows == "get_state":
                assert_same(env.get_state(), twin.get_state())
                assert_same(env.step(lost), wanted)
            assert_same(env.step(other), twin.step(other))
            assert env.digest == twin.digest


@pytest.mark.parametrize(
    ("unanswered", "follows"),
    [
        ("recv", "recv"),
        ("recv", "send"),
        ("recv", "reset"),
        ("get_state", "recv"),
        ("get_state", "get_state"),
    ],
)
def test_a_sent_step_that_got_no_answer_is_still_under_way(unanswered: str, follows: str) -> None:
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with client.make_vec("HalfCheetah", 2) as vec, client.make_vec("HalfCheetah", 2) as twin:
            vec.reset(seed=1)
            twin.reset(seed=1)
            (worker,) = environment_workers(client)
            os.kill(worker, signal.SIGSTOP)
            vec.session.deadline_ms = 100
            vec.send(np.ones((1, 6)), [1])
            with pytest.raises(TimeoutError) as caught:
                getattr(vec, unanswered)()
            if unanswered == "recv":
                assert caught.value.env_ids.tolist() == [1]
            assert caught.value.executed_unknown and caught.value.recoverable
            vec.session.deadline_ms = 120_000
            twin.send(np.ones((1, 6)), [1])
            wanted = twin.recv()
            if follows == "send":
                vec.send(np.ones((1, 6)), [1])
            if follows == "get_state":
                assert_same(vec.get_state(), twin.get_state())
            if follows == "reset":
                assert_same(vec.reset(), twin.reset())
            else:
                assert_same(vec.recv(), wanted)
            with pytest.raises(errors.FailedPreconditionError, match="no sent step"):
                vec.recv()
            assert_same(vec.step(np.zeros((2, 6))), twin.step(np.zeros((2, 6))))


@pytest.mark.parametrize("autoreset", ["next_step", "same_step", "disabled"])
def test_each_of_several_sent_steps_is_received_after_the_deadline(autoreset: str) -> None:
    options = {"num_envs": 4, "autoreset_mode": autoreset, "max_episode_steps": 1}
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        vec, twin = (client.make_vec("HalfCheetah", **options) for _ in range(2))
        with vec, twin:
            vec.reset(seed=1)
            twin.reset(seed=1)
            actions = np.linspace(-1, 1, 24).reshape(4, 6)
            wanted = {}
            for i in range(4):
                twin.send(actions[i : i + 1], [i])
                wanted[i] = twin.recv()
            (worker,) = environment_workers(client)
            vec.send(actions[3:], [3])
            assert_same(vec.recv(), wanted.pop(3))
            os.kill(worker, signal.SIGSTOP)
            vec.session.deadline_ms = 100
            for i in (0, 1):
                vec.send(actions[i : i + 1], [i])
            failed: list[int] = []

            def receive() -> None:
                try:
                    result = vec.recv()
                except TimeoutError as error:
                    failed.extend(error.env_ids.tolist())
                else:
                    assert_same(result, wanted.pop(int(result[4]["env_id"][0])))

            while len(failed) < 2:
                receive()
            vec.session.deadline_ms = 120_000
            vec.send(actions[2:3], [2])
            while wanted:
                receive()
            # One that was asked for again under the short deadline may have missed that, too.
            assert set(failed) <= {0, 1} and len(failed) <= 4
            np.testing.assert_array_equal(vec.digests, twin.digests)


def test_a_session_that_the_server_lost_says_so(client: b4mrl.Client) -> None:
    env = client.make("HalfCheetah")
    env.reset()
    copy = client.make("HalfCheetah")
    copy.reset()
    # Another holder of the token gives it back.
    env.session._connection.call(close_request(), bytearray(), 5000)
    with pytest.raises(errors.SessionLostError) as caught:
        env.step(np.zeros(6))
    assert caught.value.executed_unknown
    for call in (env.reset, env.get_state, lambda: env.step(np.zeros(6))):
        with pytest.raises(errors.SessionLostError, match=f"^{re.escape(str(caught.value))}$"):
            call()
    copy.step(np.zeros(6))
    env.close()
    copy.close()


def close_request():
    from b4mrl.wire.messages import Request

    request = Request()
    request.close.SetInParent()
    return request


def test_a_daemon_that_is_gone_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    with b4mrl.serve(tcp=True) as endpoint:
        client = b4mrl.connect(endpoint, deadline_ms=2_000)
    with pytest.raises(ConnectionError, match=f"nobody listens at {endpoint}; has the"):
        client.make("HalfCheetah")
    with pytest.raises(ConnectionError, match=f"nobody answers at {endpoint} within.*b4mrl serve"):
        b4mrl.connect(endpoint, deadline_ms=200)
    monkeypatch.setenv("B4MRL_ENDPOINT", endpoint)
    found = re.escape(f"nobody answers at {endpoint} (from B4MRL_ENDPOINT) within 0.2 s")
    with pytest.raises(ConnectionError, match=found):
        b4mrl.connect(deadline_ms=200)


@pytest.mark.parametrize("transport", ["door", "ipc", "tcp"])
def test_after_a_daemons_end_its_environments_say_so_soon(
    monkeypatch: pytest.MonkeyPatch, transport: str
) -> None:
    """A notebook's cell has left the block of `serve`, and the next one goes on."""
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 100)
    if transport == "ipc":
        monkeypatch.setattr("b4mrl.wire.routes.open_door", lambda name, wait_ms: None)
    with b4mrl.serve(tcp=transport == "tcp", workers=1) as endpoint:
        client = b4mrl.connect(endpoint)
        env = client.make("HalfCheetah")
        assert env.transport == ("ipc" if transport == "ipc" else "door")
        env.reset(seed=1)
    calls = [lambda: env.step(np.zeros(6)), env.reset, env.get_state]
    if transport != "tcp":  # there, the gateway may be at the other end of a tunnel
        calls.append(lambda: client.make("Hopper"))
    for call in calls:
        started = time.monotonic()
        with pytest.raises(errors.UnavailableError, match="nobody listens at .* has the daemon en"):
            call()
        assert time.monotonic() - started < 60  # half of its deadline


def test_a_worker_that_is_replaced_is_not_taken_for_a_daemons_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("b4mrl.wire.connection.REACH_MS", 1)
    monkeypatch.setattr("b4mrl.wire.connection._QUIET_SECONDS", 0)
    monkeypatch.setattr("b4mrl.wire.listening._LOOK_SECONDS", 0)
    with b4mrl.serve(workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with client.make("HalfCheetah") as through_door, monkeypatch.context() as patch:
            patch.setattr("b4mrl.wire.routes.open_door", lambda name, wait_ms: None)
            with client.make("HalfCheetah") as through_ipc:
                through_door.reset(seed=1)
                through_ipc.reset(seed=1)
                for how in (signal.SIGKILL, signal.SIGSTOP):
                    for env in (through_door, through_ipc):
                        (worker,) = environment_workers(client)
                        os.kill(worker, how)
                        env.step(np.ones(6))
                assert through_door.transport == "door"
                assert_same(through_door.step(np.ones(6)), through_ipc.step(np.ones(6)))


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_gymnasiums_processes_may_share_a_client(client: b4mrl.Client, context: str) -> None:
    def make() -> b4mrl.Environment:
        return client.make("HalfCheetah", "gravity")

    apart = AsyncVectorEnv([make] * 2, context=context)
    together = SyncVectorEnv([make] * 2)
    try:
        assert_same(apart.reset(seed=1), together.reset(seed=1))
        for _ in range(5):
            actions = apart.action_space.sample()
            assert_same(apart.step(actions), together.step(actions))
    finally:
        apart.close()
        together.close()


@pytest.mark.parametrize("sent", ["in the child", "in the parent"])
def test_an_environment_does_not_cross_a_fork(client: b4mrl.Client, sent: str) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset(seed=1)
        if sent == "in the parent":
            vec.send(np.zeros((2, 6)))

        def use() -> None:
            if sent == "in the child":
                vec.send(np.zeros((2, 6)))
            vec.recv()

        with pytest.raises(errors.FailedPreconditionError, match="before a fork"):
            in_a_child(use)
        if sent == "in the parent":
            vec.recv()
        vec.step(np.zeros((2, 6)))  # the parent's go on


def test_a_worker_may_die_while_the_caller_is_busy_for_longer_than_the_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        with client.make_vec("HalfCheetah", 2) as vec:
            vec.reset(seed=1)
            (worker,) = environment_workers(client)
            os.kill(worker, signal.SIGSTOP)
            vec.send(np.zeros((2, 6)))
            os.kill(worker, signal.SIGKILL)
            while environment_workers(client) in ([worker], []):
                pass  # busy elsewhere
            # For the connection, that has taken longer than the step's deadline. An eighth of the
            # deadline, which the reconnection grants, is 15 s: ample for a step.
            late = vec.session.deadline_ms / 1000 + 1
            clock = SimpleNamespace(monotonic=lambda: time.monotonic() + late)
            monkeypatch.setattr("b4mrl.wire.connection.time", clock)
            observations, *_ = vec.recv()
            monkeypatch.undo()
        with client.make_vec("HalfCheetah", 2) as twin:
            twin.reset(seed=1)
            assert_same(observations, twin.step(np.zeros((2, 6)))[0])


@contextlib.contextmanager
def daemon(*options: str) -> Iterator[None]:
    """`b4mrl serve` with these options."""
    with subprocess.Popen([*find_server(), *options], stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()


@pytest.mark.parametrize("transport", ["door", "ipc"])
def test_a_daemon_that_was_started_again_knows_no_session_and_serves_on(transport: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        address = f"ipc://{folder}/socket"
        options = ["--bind", address, "--workers", "1"] + ["--no-door"] * (transport == "ipc")
        with daemon(*options):
            client = b4mrl.connect(address)
            ledger = client.ledger()
            env = client.make("HalfCheetah")
            assert env.transport == transport
            env.reset(seed=1)
        with daemon(*options), client:
            for use in (lambda: env.step(np.zeros(6)), env.reset, env.get_state):
                with pytest.raises(errors.SessionLostError):
                    use()
            with pytest.raises(errors.UnknownNameError):
                ledger.counts()
            with client.make("HalfCheetah") as another:
                assert another.transport == transport
                another.reset(seed=1)
            env.close()  # in silence


def test_closing_does_not_wait_for_a_daemon_that_is_gone() -> None:
    with b4mrl.serve() as endpoint, b4mrl.connect(endpoint) as client:
        env = client.make("HalfCheetah")
        env.reset()
    started = time.monotonic()
    env.close()
    assert time.monotonic() - started < env.session.deadline_ms / 1000 / 2


def test_what_is_closed_says_so(client: b4mrl.Client) -> None:
    env = client.make("HalfCheetah", render_mode="rgb_array")
    env.reset()
    other = b4mrl.connect(client.endpoint)
    env.close()
    other.close()
    for call in (env.reset, env.get_state, env.render, other.environments):
        with pytest.raises(errors.FailedPreconditionError, match="closed"):
            call()


def test_each_thread_may_have_its_own_environment(endpoint: str) -> None:
    digests: dict[int, int] = {}

    def run(number: int) -> None:
        with b4mrl.connect(endpoint) as client, client.make("HalfCheetah") as env:
            env.reset(seed=1)
            for _ in range(100):
                env.step(np.full(6, 0.1))
            digests[number] = env.digest

    threads = [threading.Thread(target=run, args=(i,)) for i in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(digests) == 4 and len(set(digests.values())) == 1
