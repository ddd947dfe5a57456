"""Agents that Python saves: the programs act by them, and what no file can hold is refused."""

from __future__ import annotations

from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors

from made_agents import (
    ACTIONS,
    HIDDEN,
    RAGGED,
    SIZE,
    TOLERANCE,
    formula,
    random_layers,
    run_evaluate,
)
from made_dataset import rows_recorded_by


@pytest.mark.parametrize("activation", ["relu", "tanh"])
@pytest.mark.parametrize("hidden_layers", [0, 1, 3, 16])
def test_an_agent_is_saved_as_the_network_that_was_given(
    tmp_path: Path, activation: str, hidden_layers: int
) -> None:
    rng = np.random.default_rng(6)
    layers = random_layers([2 * SIZE, *[HIDDEN] * hidden_layers, ACTIONS])
    inputs = {
        "observation_mean": rng.normal(size=SIZE),
        "observation_std": rng.uniform(0.5, 2, size=SIZE),
        "action_scale": np.array([0.4, 2.0]),
    }
    path = tmp_path / "agent.h5"
    mask = np.array([True, False, True])
    given = {"environment": "HalfCheetah", "algorithm": "mine", "history_length": 2}
    b4mrl.save_agent(path, layers, activation, mask=mask, **inputs, **given)
    policy = b4mrl.load_agent(path)
    assert (policy.environment, policy.algorithm) == ("HalfCheetah", "mine")
    names = [*(f"fc{i}" for i in range(hidden_layers)), "last_fc"]
    entries = {"observation_mask": mask} | inputs
    for name, (weight, bias) in zip(names, layers):
        entries |= {f"{name}/weight": weight, f"{name}/bias": bias}
    a, b = rng.normal(size=(2, SIZE))
    policy(a)
    np.testing.assert_allclose(policy(b), formula(entries, [a, b], activation), atol=TOLERANCE)
    assert list(tmp_path.iterdir()) == [path]


def test_the_deviations_of_data_are_taken_where_a_dimension_is_hidden(tmp_path: Path) -> None:
    path = tmp_path / "new" / "folder" / "agent.h5"
    given = {"mask": [True, False, True], "observation_std": [2.0, 0.0, 0.5]}
    b4mrl.save_agent(path, [(np.eye(3), np.zeros(3))], **given)
    actions = b4mrl.load_agent(path)(np.ones(3))
    np.testing.assert_allclose(actions, np.tanh([0.5, 0, 2]), atol=TOLERANCE)


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_the_programs_act_by_a_saved_agent_as_python_does(tmp_path: Path, activation: str) -> None:
    path = tmp_path / "agent.h5"
    given = {"environment": "HalfCheetah", "mask": np.arange(17) != 9}
    b4mrl.save_agent(path, random_layers([17, 32, 32, 32, 6]), activation, **given)
    assert run_evaluate(path)["lengths"] == [1000]
    rows = rows_recorded_by(path, tmp_path / "data")
    actions = b4mrl.load_agent(path)(rows["observations"])
    assert len(actions) == 10_000 and rows["actions"].std() > 0.1
    np.testing.assert_allclose(actions, rows["actions"], atol=TOLERANCE)


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"activation": "gelu"}, "relu, tanh"),
        ({"layers": []}, r"1\.\.17"),
        ({"layers": random_layers([3] * 19)}, r"1\.\.17"),
        ({"layers": random_layers([3, 5, 2])[:1] + random_layers([4, 2])}, r"\(outputs, 5\)"),
        ({"layers": [(np.zeros((2, 3)), np.zeros(3))]}, r"\(outputs,\)"),
        ({"layers": [(np.zeros(3), np.zeros(3))]}, "outputs"),
        ({"layers": [(1.0, 1.0)]}, r"\(outputs, inputs\)"),
        ({"layers": [(np.zeros((2, 3)), [1j, 2j])]}, "complex numbers"),
        ({"path": ""}, "the path of a file"),
        ({"path": "/"}, "the path of a file"),
        ({"path": "\ud800"}, "a path"),
        ({"layers": [(np.zeros((2, 5000)), np.zeros(2))]}, "4096"),
        ({"layers": random_layers([3, 1025])}, r"1\.\.1024"),
        ({"layers": [(np.full((2, 3), np.nan), np.zeros(2))]}, "finite"),
        ({"mask": np.ones(4)}, "3, all of them finite"),
        ({"observation_std": [1, 0, 1]}, r"observation_std\[1\] is 0.0, .*above 0, .*add a small"),
        ({"observation_std": [1, -1, 1], "mask": [1, 0, 1]}, r"observation_std\[1\] is -1.0, .*0"),
        ({"observation_mean": [0, 0, np.inf]}, "finite"),
        ({"action_scale": [1.0]}, "2, all"),
        ({"history_length": 2}, "a divisor of the first layer's 3 inputs"),
    ],
)
def test_what_no_agent_file_can_hold_is_refused_with_what_is_allowed(
    tmp_path: Path, changes: dict, allowed: str
) -> None:
    given = {"path": tmp_path / "agent.h5", "layers": random_layers([3, 5, 2])} | changes
    with pytest.raises(errors.InvalidArgumentError, match=allowed):
        b4mrl.save_agent(**given)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("layers", value) for value in (None, 3, "abc", [3], [(1, 2, 3)], [(RAGGED, [1])])),
        *(("activation", value) for value in (None, np.zeros(2))),
        *(("environment", value) for value in (None, 3, "\ud800", "x" * 70_000, "a\0b")),
        *(("algorithm", value) for value in (3, RAGGED)),
        *(("mask", value) for value in ("abc", RAGGED, {})),
        ("action_scale", "abc"),
        ("action_scale", [10**400, 1]),
        *(("history_length", value) for value in (None, "abc", 0, 65)),
        *(("seed", value) for value in ("abc", -1)),
        *(("updates", value) for value in (None, "abc", -1, 2**53 + 1)),
    ],
)
def test_an_argument_of_another_type_is_refused_before_a_file_is_written(
    tmp_path: Path, name: str, value: object
) -> None:
    given = {"layers": random_layers([3, 5, 2])} | {name: value}
    with pytest.raises(errors.InvalidArgumentError, match=f"{name}.*allowed"):
        b4mrl.save_agent(tmp_path / "agent.h5", **given)
    assert not list(tmp_path.iterdir())
