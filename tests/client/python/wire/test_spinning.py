"""When a wait is spent looking, and when asleep."""

from __future__ import annotations

import os
import threading

import pytest
from b4mrl.wire import spinning
from b4mrl.wire.spinning import Spinner


class Clock:
    """A clock that a test moves on; each look at it takes a microsecond."""

    def __init__(self) -> None:
        self.now = 1.0
        self.used_by_others = 100.0  # processor time of the process's other threads

    def perf_counter(self) -> float:
        self.now += 1e-6
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(spinning.time, "perf_counter", clock.perf_counter)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    monkeypatch.setattr(threading, "active_count", lambda: 1)
    monkeypatch.setattr(spinning.time, "process_time", lambda: 7 + clock.used_by_others)
    monkeypatch.setattr(spinning.time, "thread_time", lambda: 7)
    return clock


def never(_: int) -> bool:
    return False


def test_a_short_wait_is_spent_looking(clock: Clock) -> None:
    looks = iter([False] * 20 + [True])
    assert Spinner(100e-6).spin(lambda _: next(looks))
    assert clock.now < 1 + 50e-6


def test_a_wait_ends_with_its_budget(clock: Clock) -> None:
    assert not Spinner(100e-6).spin(never)
    assert 1 + 99e-6 < clock.now < 1 + 110e-6


def test_long_waits_are_slept_through_until_short_ones_come_again(clock: Clock) -> None:
    spinner = Spinner(100e-6)
    for _ in range(30):
        spinner.learn(1.0)
    began = clock.now
    assert not spinner.spin(lambda _: True) and clock.now - began < 5e-6
    for _ in range(30):
        spinner.learn(20e-6)
    assert spinner.spin(lambda _: True)


@pytest.mark.parametrize("is_over", [False, True])
def test_after_the_loss_of_a_slice_it_rests_for_many_times_as_long(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, is_over: bool
) -> None:
    def give_the_core_away() -> None:
        clock.now += 3e-3

    monkeypatch.setattr(os, "sched_yield", give_the_core_away)
    spinner = Spinner(100e-6)
    answers = iter([False, is_over])
    assert spinner.spin(lambda _: next(answers)) == is_over
    began = clock.now
    clock.now = began + 0.09
    assert not spinner.spin(lambda _: True)
    clock.now = began + 0.1
    assert spinner.spin(lambda _: True)


def test_after_a_wait_in_vain_it_rests_for_a_short_time(clock: Clock) -> None:
    spinner = Spinner(100e-6)
    assert not spinner.spin(never)
    began = clock.now
    clock.now = began + 700e-6
    assert not spinner.spin(lambda _: True)
    clock.now = began + 900e-6
    assert spinner.spin(lambda _: True)


def test_a_peer_on_the_same_core_causes_no_rest(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    def let_the_peer_work() -> None:
        clock.now += 60e-6

    monkeypatch.setattr(os, "sched_yield", let_the_peer_work)
    spinner = Spinner(100e-6)
    answers = iter([False, True])
    assert spinner.spin(lambda _: next(answers))
    assert spinner.spin(lambda _: True)


@pytest.mark.parametrize("what", ["no budget", "one core"])
def test_where_looking_would_hold_others_up_it_never_looks(
    clock: Clock, monkeypatch: pytest.MonkeyPatch, what: str
) -> None:
    if what == "one core":
        monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    assert not Spinner(0.0 if what == "no budget" else 100e-6).spin(lambda _: True)


def test_it_looks_while_the_processs_other_threads_are_idle(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(threading, "active_count", lambda: 2)
    spinner = Spinner(100e-6)

    def spins_after(used: float) -> bool:
        clock.now += 0.1
        clock.used_by_others += used
        return spinner.spin(lambda _: True)

    spins_after(0.0)
    assert spins_after(0.0)
    assert spins_after(0.001)
    assert not spins_after(0.01)
    assert not spinner.spin(lambda _: True)
    assert spins_after(0.0)
    assert not spins_after(-1.0)  # the connection's user is another thread now
    assert spins_after(0.0)
