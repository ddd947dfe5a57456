"""Checks of arguments: what may be given, and that errors name it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks import result_file
from b4mrl.benchmarks.evaluation import given_returns
from b4mrl.wire import checks


@pytest.mark.parametrize("given", ["a/b", b"a/b", Path("a/b"), np.str_("a/b")])
def test_a_path_may_be_a_text_bytes_or_a_path(given: object) -> None:
    assert checks.path("folder", given) == Path("a/b")


@pytest.mark.parametrize("wrong", [None, 3, 1.5, [], ["a"], "a\0b", b"a\0", "\ud800", object()])
def test_what_is_no_path_is_refused_by_name(wrong: object) -> None:
    allowed = re.escape("allowed: a path, as a text or a pathlib.Path")
    with pytest.raises(errors.InvalidArgumentError, match=f"^path is .*, {allowed}$"):
        b4mrl.load_agent(wrong)
    with pytest.raises(errors.InvalidArgumentError, match=f"^path is .*, {allowed}$"):
        b4mrl.save_agent(wrong, [(np.zeros((6, 17)), np.zeros(6))])
    with pytest.raises(errors.InvalidArgumentError, match=f"^folder is .*, {allowed}$"):
        result_file.find(wrong, "HalfCheetah/clean/medium")


@pytest.mark.parametrize(
    ("rows", "wanted"),
    [
        (slice(None), range(0, 9)),
        (slice(-3, None), range(6, 9)),
        (slice(np.int64(2), np.uint8(4), np.int64(1)), range(2, 4)),
        (slice(20, 30), range(9, 9)),
        (slice(7, 3), range(0)),
    ],
)
def test_a_slice_names_its_rows(rows: slice, wanted: range) -> None:
    assert checks.row_slice(rows, 9) == wanted


@pytest.mark.parametrize(
    "wrong",
    [3, "rewards", ..., (1, 2), np.arange(3)]
    + [slice(0, 9, step) for step in (2, 0, -1, 1.0, "x")]
    + [slice("a"), slice(0.0, 3)],
)
def test_what_is_no_slice_of_rows_is_refused(wrong: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="^the index is .*allowed: a slice of ro"):
        checks.row_slice(wrong, 9)


def test_an_integer_beyond_all_floats_is_refused(client: b4mrl.Client) -> None:
    vast = 10**400
    with pytest.raises(errors.InvalidArgumentError, match="^deadline_ms is 1000.*a finite number"):
        client.make("Hopper", deadline_ms=vast)
    with client.make("Hopper") as env, client.make_vec("Hopper", 1) as vec:
        for call in (lambda: env.step([vast] * 3), lambda: vec.step([[vast] * 3])):
            with pytest.raises(errors.InvalidArgumentError, match="allowed: numbers of shape"):
                call()
    with pytest.raises(errors.InvalidArgumentError, match="^returns is .*finite number"):
        given_returns([vast])


GRAVITY = "HalfCheetah/simulators/gravity"
ROW = np.zeros((1, 17)), np.zeros((1, 6))


@pytest.mark.parametrize(
    ("call", "complaint"),
    [
        (lambda it: it.make("Hopper", config=3), "config is 3, allowed: a dict"),
        (lambda it: it.make("Hopper", config=["a"]), "config is ['a'], allowed: a dict"),
        (lambda it: it.dataset("Hopper/mine", 3), "corruption is 3, allowed: 'gravity"),
        (
            lambda it: it.dataset("Hopper/mine", open_deadline_ms="x"),
            "open_deadline_ms is 'x', allowed: a finite number above 0",
        ),
        (lambda it: it.make("Hopper", dtype="\ud800"), r"dtype is '\ud800', allowed: float32"),
        (
            lambda it: it.make_vec("Hopper", autoreset_mode="\ud800"),
            r"autoreset_mode is '\ud800', allowed: next_step",
        ),
        (lambda it: b4mrl.connect("tcp://\ud800"), r"address is 'tcp://\ud800'"),
        (
            lambda it: it.make_vec("Hopper").set_state(np.array(3)),
            "states are array(3), allowed: a list of 1 states",
        ),
        (lambda it: it.query("HalfCheetah", *ROW, seed="x"), "seed is 'x', allowed"),
        (lambda it: it.query("HalfCheetah", *ROW, first_row="x"), "first_row is 'x', allowed"),
        (
            lambda it: it.benchmark(GRAVITY).evaluate(len, episodes=1025),
            "episodes is 1025, allowed: an integer in 1..1024",
        ),
        (
            lambda it: b4mrl.benchmark(GRAVITY, endpoint=it.endpoint, rows=-1),
            "rows is -1, allowed: an integer of at least 0",
        ),
        (lambda it: b4mrl.suite(endpoint=it.endpoint, rows="x"), "rows is 'x', allowed"),
    ],
)
def test_an_argument_is_named_as_the_caller_gave_it(
    client: b4mrl.Client, call: Callable[[b4mrl.Client], object], complaint: str
) -> None:
    with pytest.raises(errors.InvalidArgumentError, match=f"^{re.escape(complaint)}"):
        call(client)


def test_a_query_that_is_refused_takes_no_draw(client: b4mrl.Client) -> None:
    wanted = client.query("HalfCheetah", *ROW, "obs-noise=0.1", draw=0)[0]
    with pytest.raises(errors.InvalidArgumentError):
        client.query("HalfCheetah", *ROW, "obs-noise=0.1", seed=-1)
    np.testing.assert_array_equal(client.query("HalfCheetah", *ROW, "obs-noise=0.1")[0], wanted)


@pytest.mark.filterwarnings("error")
def test_numbers_of_numpy_are_compared_as_pythons_are() -> None:
    assert checks.positive("deadline_ms", np.float32(5000)) == 5000.0
    for wrong in (np.float32("inf"), np.float32("nan"), 10**400, np.int8(0)):
        with pytest.raises(errors.InvalidArgumentError, match="^deadline_ms is "):
            checks.positive("deadline_ms", wrong)
