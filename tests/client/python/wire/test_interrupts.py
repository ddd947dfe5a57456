"""Ctrl-C, or an alarm's exception, in the middle of a call."""

from __future__ import annotations

import functools
import os
import pkgutil
import random
import signal
import threading
import time
import warnings
from collections.abc import Iterator
from types import FrameType
from typing import Any

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.wire.operations import Operations

from conftest import environment_workers
from equality import assert_same
from interrupting import interrupt

# Where Ctrl-C comes: a function of the client, whether before or after it has done its work, and
# whether the interrupted operation happens.
INTERRUPTIONS = [
    ("b4mrl.wire.lane_numbers.LaneNumbers.begin", "before", False),
    ("b4mrl.wire.lane_numbers.LaneNumbers.begin", "after", False),
    ("b4mrl.wire.plans.pack", "before", False),
    ("b4mrl.wire.plans.pack", "after", False),
    ("b4mrl.wire.connection.Connection.send", "before", False),
    ("b4mrl.wire.connection.Connection._transmit", "before", True),
    ("zmq.Socket.send", "after", True),  # half a message is sent
    ("b4mrl.wire.ring.RingWriter.push", "before", True),
    ("b4mrl.wire.ring.RingWriter.push", "after", True),
    ("b4mrl.wire.ring.RingWriter.write", "after", True),  # and no bell rings
    ("b4mrl.wire.connection.Connection._transmit", "after", True),
    ("b4mrl.wire.connection.Connection.send", "after", True),
    ("b4mrl.wire.connection.Connection.await_any", "before", True),
    ("b4mrl.wire.ring.RingReader.has_bytes", "before", True),
    ("b4mrl.wire.ring.RingReader.take", "after", True),  # a message is lost
    ("b4mrl.wire.connection.Connection._read", "after", True),  # a message is lost
    ("b4mrl.wire.connection.Connection._accept", "after", True),
    ("b4mrl.wire.connection.Connection.await_any", "after", True),
    ("b4mrl.wire.outcomes.OutcomeReader.lane_step", "after", True),
    ("b4mrl.infos.InfoLayout.single", "after", True),
    ("b4mrl.wire.lane_numbers.LaneNumbers.end", "before", True),
    ("b4mrl.wire.lane_numbers.LaneNumbers.end", "after", True),
]
everywhere = pytest.mark.parametrize(("place", "when", "happens"), INTERRUPTIONS)


@pytest.fixture(params=["door", "tcp"])
def pair(
    client: b4mrl.Client, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[tuple[b4mrl.Environment, b4mrl.Environment]]:
    """An environment to be interrupted, and one that is left alone."""
    other = {"door": "zmq.", "tcp": "b4mrl.wire.ring"}[request.param]
    if request.node.callspec.params.get("place", "").startswith(other):
        pytest.skip("not on this way")
    if request.param == "tcp":
        monkeypatch.setattr("b4mrl.wire.routes.open_door", lambda name, wait_ms: None)
    options = {"simulator": "obs-noise=0.1", "config": {"max_episode_steps": 7}}
    with (
        client.make("HalfCheetah", **options) as env,
        client.make("HalfCheetah", **options) as twin,
    ):
        env.reset(seed=1)
        twin.reset(seed=1)
        assert env.transport == request.param
        yield env, twin


@everywhere
def test_the_same_step_again_is_as_if_nothing_had_happened(pair, place, when, happens) -> None:
    env, twin = pair
    for i in range(10):  # over the end of an episode
        action = np.full(6, 0.1 * i)
        interrupt(lambda: env.step(action), place, when)
        assert_same(env.step(action.copy()), twin.step(action))
        assert_same(env.step(action), twin.step(action))
    assert env.digest == twin.digest


@everywhere
def test_another_step_goes_on_behind_it_and_says_so(pair, place, when, happens) -> None:
    env, twin = pair
    lost, other = np.full(6, 0.5), np.full(6, -0.5)
    interrupt(lambda: env.step(lost), place, when)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = env.step(other)
    if happens:
        twin.step(lost)
        assert [str(warning.message)[:20] for warning in caught] == ["the interrupted step"]
        assert caught[0].filename == __file__
    else:
        assert caught == []
    assert_same(result, twin.step(other))


@everywhere
@pytest.mark.parametrize("seed", [None, 2])
def test_a_reset_needs_to_know_nothing_of_it(pair, place, when, happens, seed) -> None:
    env, twin = pair
    interrupt(lambda: env.step(np.ones(6)), place, when)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert_same(env.reset(seed=seed), twin.reset(seed=seed))
        assert_same(env.step(np.zeros(6)), twin.step(np.zeros(6)))


@everywhere
def test_so_it_is_with_a_reset(pair, place, when, happens) -> None:
    if place.endswith("OutcomeReader.lane_step"):
        place = place.replace("lane_step", "outcome")
    env, twin = pair
    for _ in range(2):  # an unseeded reset must not begin two episodes
        interrupt(lambda: env.reset(), place, when)
        assert_same(env.reset(), twin.reset())
        assert_same(env.step(np.zeros(6)), twin.step(np.zeros(6)))


@everywhere
def test_so_it_is_with_a_state_that_is_set(pair, place, when, happens) -> None:
    if place.startswith("b4mrl.infos"):
        pytest.skip("a state has no infos")
    place = place.replace("OutcomeReader.lane_step", "OutcomeReader.observations")
    env, twin = pair
    state = env.get_state()
    for _ in range(2):
        interrupt(lambda: env.set_state(state), place, when)
        assert_same(env.set_state(state), twin.set_state(state))
        assert_same(env.step(np.ones(6)), twin.step(np.ones(6)))


def test_states_are_those_behind_what_was_interrupted(pair) -> None:
    env, twin = pair
    interrupt(lambda: env.step(np.ones(6)), "b4mrl.wire.connection.Connection.await_any", "before")
    result = twin.step(np.ones(6))
    assert_same(env.get_state(), twin.get_state())
    assert_same(env.step(np.ones(6)), result)  # and the outcome is still there


@pytest.mark.parametrize("call", ["get_state", "render"])
def test_what_was_to_be_read_keeps_no_lane_busy(client: b4mrl.Client, call: str) -> None:
    with client.make_vec("Humanoid", 64, render_mode="rgb_array", width=16, height=16) as vec:
        vec.reset(seed=1)
        operations = vec.session._operations
        for seed in range(10):
            interrupt(getattr(vec, call), "b4mrl.wire.connection.Connection.receive_any", "before")
            assert operations._connection.is_in_flight(operations._reading)
            vec.reset(seed=seed)  # while the daemon may be reading the lanes
            assert operations._reading == 0


@pytest.mark.parametrize(("place", "when"), [("send", "after"), ("_transmit", "after")])
def test_an_interrupted_send_may_be_made_again(client: b4mrl.Client, place: str, when: str) -> None:
    with client.make_vec("HalfCheetah", 4) as vec, client.make_vec("HalfCheetah", 4) as twin:
        vec.reset(seed=1)
        twin.reset(seed=1)
        actions = vec.action_space.sample()
        vec.send(actions[:2], [0, 1])
        again = lambda: vec.send(actions[2:], [2, 3])  # noqa: E731
        interrupt(again, "b4mrl.wire.connection.Connection." + place, when)
        again()
        interrupt(vec.recv, "b4mrl.wire.connection.Connection.await_any", "after")
        expected = twin.step(actions)[0]
        for _ in range(2):  # whichever send is answered first
            observations, *_, info = vec.recv()
            assert_same(observations, expected[info["env_id"]])


@pytest.mark.parametrize("between", ["nothing", "a send", "a state"])
def test_what_was_not_sent_keeps_no_environment_busy(client: b4mrl.Client, between: str) -> None:
    with client.make_vec("HalfCheetah", 4) as vec, client.make_vec("HalfCheetah", 4) as twin:
        vec.reset(seed=1)
        twin.reset(seed=1)
        actions = vec.action_space.sample()
        expected = twin.step(actions)[0]
        place = "b4mrl.wire.connection.Connection.send"
        interrupt(lambda: vec.send(actions[:2] + 1, [0, 1]), place, "before")
        if between == "a send":  # which gets the request id that the other one was to have
            vec.send(actions[2:], [2, 3])
            assert_same(vec.recv()[0], expected[2:])
        elif between == "a state":
            vec.get_state()
        vec.send(actions[:2], [0, 1])
        assert_same(vec.recv()[0], expected[:2])


@pytest.mark.parametrize("autoreset", ["next_step", "same_step", "disabled"])
@pytest.mark.parametrize(
    ("place", "when"),
    [
        ("b4mrl.vector_environment.VectorEnvironment._result", "after"),
        ("b4mrl.wire.lane_numbers.LaneNumbers.end", "before"),
    ],
)
def test_an_outcome_of_a_batch_that_is_read_twice_is_the_same(
    client: b4mrl.Client, autoreset: str, place: str, when: str
) -> None:
    options: dict[str, Any] = {"autoreset_mode": autoreset, "max_episode_steps": 2}
    with (
        client.make_vec("Hopper", 2, **options) as vec,
        client.make_vec("Hopper", 2, **options) as twin,
    ):
        vec.reset(seed=1)
        twin.reset(seed=1)
        for _ in range(5):  # over the ends of two episodes
            actions = vec.action_space.sample()
            interrupt(functools.partial(vec.step, actions), place, when)
            result = vec.step(actions)
            assert_same(result, twin.step(actions))
            if autoreset == "disabled" and result[3].any():
                with pytest.raises(errors.FailedPreconditionError, match="has ended"):
                    vec.step(actions)
                assert_same(vec.reset(seed=1), twin.reset(seed=1))
        np.testing.assert_array_equal(vec.digests, twin.digests)


@pytest.mark.filterwarnings("ignore:the interrupted step")
def test_a_batch_knows_of_the_episodes_that_ended_in_a_dropped_outcome(
    client: b4mrl.Client,
) -> None:
    place = "b4mrl.wire.connection.Connection.await_any"
    for autoreset in ("next_step", "disabled"):
        options: dict[str, Any] = {"autoreset_mode": autoreset, "max_episode_steps": 1}
        with (
            client.make_vec("Hopper", 2, **options) as vec,
            client.make_vec("Hopper", 2, **options) as twin,
        ):
            vec.reset(seed=1)
            twin.reset(seed=1)
            interrupt(lambda: vec.step(np.ones((2, 3))), place, "before")
            twin.step(np.ones((2, 3)))
            for batch in (vec, twin):
                if autoreset == "disabled":
                    with pytest.raises(errors.FailedPreconditionError, match="has ended"):
                        batch.step(np.zeros((2, 3)))
                    batch.reset(options={"reset_mask": [True, False]})
            if autoreset == "next_step":
                assert_same(vec.step(np.zeros((2, 3))), twin.step(np.zeros((2, 3))))
            np.testing.assert_array_equal(vec.digests, twin.digests)


@pytest.mark.parametrize("place", ["zmq.Socket.send", "b4mrl.wire.ring.RingWriter.write"])
def test_a_request_that_was_cut_while_it_was_sent_costs_no_time(pair, place) -> None:
    env, twin = pair
    start = time.monotonic()
    interrupt(lambda: env.step(np.ones(6)), place, "after")
    assert_same(env.step(np.ones(6)), twin.step(np.ones(6)))
    assert time.monotonic() - start < 10  # a resend would come after an eighth of two minutes


# Where Python cannot raise, as in a destructor of pyzmq, it says so.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("transport", ["door", "tcp"])
@pytest.mark.parametrize("exception", [KeyboardInterrupt, TimeoutError])
def test_interrupts_at_any_moment_of_waiting_change_nothing(
    client: b4mrl.Client,
    monkeypatch: pytest.MonkeyPatch,
    exception: type[BaseException],
    transport: str,
) -> None:
    """Real signals, while a reply is waited for or read."""
    if transport == "tcp":
        monkeypatch.setattr("b4mrl.wire.routes.open_door", lambda name, wait_ms: None)
    draws = random.Random(5)
    hits = caught = 0

    def arrive(_: int, frame: FrameType | None) -> None:
        nonlocal hits
        codes = []
        while frame is not None:
            codes.append(frame.f_code)
            frame = frame.f_back
        if Operations.call.__code__ in codes and Operations._end.__code__ not in codes:
            hits += 1
            raise exception

    before = signal.signal(signal.SIGALRM, arrive)
    options: dict[str, Any] = {"num_envs": 16, "autoreset_mode": "same_step", "deadline_ms": 60_000}
    try:
        with (
            client.make_vec("Hopper", **options) as vec,
            client.make_vec("Hopper", **options) as twin,
        ):
            vec.reset(seed=3)
            twin.reset(seed=3)
            vec.action_space.seed(3)
            for _ in range(100):
                actions = vec.action_space.sample()
                result, interrupts = None, 0
                while result is None:
                    if interrupts < 3:
                        signal.setitimer(signal.ITIMER_REAL, draws.uniform(20e-6, 500e-6))
                    try:
                        result = vec.step(actions)
                    except exception as error:
                        assert type(error) is exception  # none of the client's own TimeoutErrors
                        interrupts += 1
                caught += interrupts
                signal.setitimer(signal.ITIMER_REAL, 0)
                assert_same(result, twin.step(actions))
            np.testing.assert_array_equal(vec.digests, twin.digests)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert hits > 20
    if transport == "door":
        assert caught == hits


def test_a_signal_handler_is_refused_the_environment_that_waits(client: b4mrl.Client) -> None:
    """A batch system's warning, whose handler saves the state: the step under way is not hurt."""
    draws = random.Random(5)
    saved = refused = 0

    def save(*_: object) -> None:
        nonlocal saved, refused
        try:
            env.get_state()
            saved += 1
        except errors.FailedPreconditionError as error:
            assert "signal handler" in str(error)
            refused += 1

    before = signal.signal(signal.SIGALRM, save)
    try:
        with client.make("Hopper") as env, client.make("Hopper") as twin:
            env.reset(seed=3)
            twin.reset(seed=3)
            env.action_space.seed(3)
            for _ in range(300):
                action = env.action_space.sample()
                signal.setitimer(signal.ITIMER_REAL, draws.uniform(20e-6, 200e-6))
                step = env.step(action)
                signal.setitimer(signal.ITIMER_REAL, 0)
                assert_same(step, twin.step(action))
                if step[2]:
                    assert_same(env.reset(), twin.reset())
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)
    assert refused > 10


def test_a_signal_handler_takes_nothing_from_a_call_that_reads(client: b4mrl.Client) -> None:
    refused = []

    def use(*_: object) -> None:
        for call in (vec.get_state, vec.recv):
            with pytest.raises(errors.FailedPreconditionError, match="signal handler"):
                call()
        refused.append(True)

    place = "b4mrl.wire.connection.Connection.await_any"
    original = pkgutil.resolve_name(place)
    with client.make_vec("Hopper", 2) as vec, pytest.MonkeyPatch.context() as patch:
        vec.reset(seed=3)
        expected = vec.get_state()
        patch.setattr(place, lambda *arguments: (use(), original(*arguments))[1])
        assert_same(vec.get_state(), expected)
        vec.send(np.zeros((2, 3)))
        before = len(refused)
        assert vec.recv()[0].shape == (2, 11)
        assert len(refused) > before > 0


def test_a_signal_reaches_a_call_that_waits() -> None:
    with b4mrl.serve(tcp=True, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        env = client.make("HalfCheetah")
        env.reset()
        (worker,) = environment_workers(client)
        os.kill(worker, signal.SIGSTOP)
        timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
        # A shell starts its background jobs with SIGINT ignored, which Python leaves so.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        timer.start()
        try:
            with pytest.raises(KeyboardInterrupt):
                while True:
                    env.step(np.zeros(6))
        finally:
            timer.join()
            signal.signal(signal.SIGINT, before)
        env.reset()  # by the worker that replaces the frozen one
        env.close()
