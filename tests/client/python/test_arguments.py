"""Impossible arguments of other types: each is refused by a B4mrlError that names it."""

from __future__ import annotations

from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks import evaluation, result_file

RAGGED = [[1], [1, 2]]


@pytest.mark.parametrize("state", [None, 3, [], "abc", {1: 2}, {"\ud800": [1.0]}, np.zeros(3)])
def test_what_is_no_state_is_refused_and_changes_nothing(
    client: b4mrl.Client, state: object
) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        env.reset(seed=1)
        vec.reset(seed=1)
        before = env.get_state()
        with pytest.raises(errors.InvalidArgumentError, match="state is|name in state is"):
            env.set_state(state)
        for states in ([before, state], state):
            with pytest.raises(errors.InvalidArgumentError, match="state"):
                vec.set_state(states)
        assert env.get_state()["snapshot"] == before["snapshot"]
        assert vec.get_state()[0]["snapshot"] == before["snapshot"]


@pytest.mark.parametrize("options", [3, "abc", [1], [("reset_mask", 1)], np.zeros(3), {"speed": 1}])
def test_options_that_there_are_not_are_refused(client: b4mrl.Client, options: object) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        for reset in (env.reset, vec.reset):
            with pytest.raises(errors.InvalidArgumentError, match="options is .*config="):
                reset(options=options)


def test_lists_of_unequal_lengths_are_no_numbers_of_environments(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset(seed=1)
        for call in (vec.get_state, lambda ids: vec.send(np.zeros((1, 6)), ids)):
            with pytest.raises(errors.InvalidArgumentError, match=r"env_ids .* allowed: .* 0\.\.1"):
                call(RAGGED)
        with pytest.raises(errors.InvalidArgumentError, match="reset_mask.*one True"):
            vec.reset(options={"reset_mask": RAGGED})


@pytest.mark.parametrize("value", [3, "abc", [("a", 1)], {3: 4}, {"x": float("nan")}, {"x": 1j}])
def test_hyperparameters_that_no_result_can_hold_are_refused(value: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="hyperparameters .*allowed"):
        result_file.plain_hyperparameters(value)
    assert result_file.plain_hyperparameters(None) == {}


@pytest.mark.parametrize("returns", ["abc", {"x": 1}, RAGGED, object()])
def test_returns_that_are_no_numbers_are_refused(returns: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="returns are .*allowed|returns is .*all"):
        evaluation.given_returns(returns)


@pytest.mark.parametrize("value", [None, 3, [], b"a", ["HalfCheetah/*"]])
def test_patterns_and_versions_of_suites_are_texts(endpoint: str, value: object) -> None:
    for name in ("pattern", "version"):
        with pytest.raises(errors.InvalidArgumentError, match=f"{name} is .*allowed: a text"):
            b4mrl.suite(endpoint=endpoint, **{name: value})


LAYERS = [(np.zeros((6, 17)), np.zeros(6))]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("layers", value) for value in (None, 3, "abc", [3], [(1, 2, 3)], [(RAGGED, [1])])),
        *(("activation", value) for value in (None, np.zeros(2))),
        *(("environment", value) for value in (None, 3, "\ud800", "x" * 70_000, "a\0b")),
        *(("algorithm", value) for value in (3, RAGGED)),
        *(("mask", value) for value in ("abc", RAGGED, {})),
        ("action_scale", "abc"),
        *(("history_length", value) for value in (None, "abc", 0, 65)),
        *(("seed", value) for value in ("abc", -1)),
        *(("updates", value) for value in (None, "abc", -1, 2**53 + 1)),
    ],
)
def test_what_no_agent_file_can_hold_is_refused_before_it_is_written(
    tmp_path: Path, name: str, value: object
) -> None:
    with pytest.raises(errors.InvalidArgumentError, match=f"{name}.*allowed"):
        b4mrl.save_agent(tmp_path / "agent.h5", **{"layers": LAYERS} | {name: value})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("observation", ["abc", RAGGED, {}, ["a"] * 17, object()])
def test_what_is_no_observation_is_refused_by_a_policy(tmp_path: Path, observation: object) -> None:
    b4mrl.save_agent(tmp_path / "agent.h5", LAYERS)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    with pytest.raises(errors.InvalidArgumentError, match="observation is .*allowed"):
        policy(observation)
