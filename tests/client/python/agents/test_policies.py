"""Policies: the arithmetic against a plain formula, and the agent that the project carries."""

from __future__ import annotations

from pathlib import Path

import b4mrl
import numpy as np
import pytest
from b4mrl import errors

from made_agents import (
    ACTIONS,
    CARRIED,
    HIDDEN,
    RAGGED,
    SIZE,
    TOLERANCE,
    formula,
    random_layers,
    write_agent,
)


@pytest.mark.parametrize("hidden_layers", [1, 2, 3, 8])
def test_an_action_is_the_networks(tmp_path: Path, hidden_layers: int) -> None:
    rng = np.random.default_rng(4)
    further = {}
    for layer in range(1, hidden_layers):
        further[f"fc{layer}/weight"] = rng.normal(size=(HIDDEN, HIDDEN)) / HIDDEN**0.5
        further[f"fc{layer}/bias"] = rng.normal(size=HIDDEN)
    entries = write_agent(tmp_path / "agent.h5", **further)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    assert (policy.observation_size, policy.action_size) == (SIZE, ACTIONS)
    assert policy.environment == "HalfCheetah"
    observations = np.random.default_rng(0).normal(size=(4, SIZE))
    batch = policy(observations)
    assert batch.shape == (4, ACTIONS) and batch.dtype == np.float32
    for observation, action in zip(observations, batch):
        np.testing.assert_allclose(action, formula(entries, [observation]), atol=TOLERANCE)
        np.testing.assert_allclose(policy(observation), action, atol=TOLERANCE)


def test_a_table_of_numbers_is_one_observation(tmp_path: Path) -> None:
    write_agent(tmp_path / "agent.h5")
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    numbers = np.arange(SIZE, dtype=np.float32)
    assert policy(numbers).shape == (ACTIONS,)
    np.testing.assert_array_equal(policy(numbers.reshape(SIZE, 1)), policy(numbers))
    np.testing.assert_array_equal(policy(numbers.reshape(1, SIZE, 1)), policy(numbers[None]))


def test_a_hidden_dimension_is_not_seen_whatever_it_holds(tmp_path: Path) -> None:
    write_agent(tmp_path / "agent.h5")
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    np.testing.assert_array_equal(policy([1.0, 0.0, 2.0]), policy([1.0, np.nan, 2.0]))


def test_a_history_starts_with_copies_of_the_first_observation(tmp_path: Path) -> None:
    entries = write_agent(tmp_path / "agent.h5", history=3)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    a, b, c = np.random.default_rng(0).normal(size=(3, 2, SIZE))

    def check(actions: np.ndarray, histories: list[list[np.ndarray]]) -> None:
        for action, history in zip(actions, histories):
            np.testing.assert_allclose(action, formula(entries, history), atol=TOLERANCE)

    check(policy(a), [[a[0], a[0], a[0]], [a[1], a[1], a[1]]])
    check(policy(b), [[a[0], a[0], b[0]], [a[1], a[1], b[1]]])
    policy.reset([False, True])
    check(policy(c), [[a[0], b[0], c[0]], [c[1], c[1], c[1]]])
    policy.reset()
    check(policy(b), [[b[0], b[0], b[0]], [b[1], b[1], b[1]]])
    for wrong in ([2], [0.5], [True], "a", RAGGED, {}):
        with pytest.raises(errors.InvalidArgumentError, match="rows (is|are) .*allowed: numbers"):
            policy.reset(wrong)
    policy.reset([])
    policy.reset(1)
    check(policy(c), [[b[0], b[0], c[0]], [c[1], c[1], c[1]]])


def test_a_batch_of_another_size_is_refused_by_a_policy_with_histories_until_it_is_reset(
    tmp_path: Path,
) -> None:
    entries = write_agent(tmp_path / "agent.h5", history=2)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    a, b = np.random.default_rng(0).normal(size=(2, 3, SIZE))
    policy(a)
    for other in (b[1:], b[0]):  # whose histories would these be?
        count = len(np.atleast_2d(other))
        with pytest.raises(errors.InvalidArgumentError, match=f"has {count} rows, allowed: 3,"):
            policy(other)
    wanted = formula(entries, [a[1], b[1]])
    np.testing.assert_allclose(policy(b)[1], wanted, atol=TOLERANCE)  # the histories go on
    policy.reset()
    np.testing.assert_allclose(policy(b[1:])[0], formula(entries, [b[1]] * 2), atol=TOLERANCE)


def test_evaluations_of_any_number_of_episodes_take_a_policy_with_histories(
    client: b4mrl.Client, tmp_path: Path
) -> None:
    b4mrl.save_agent(tmp_path / "agent.h5", random_layers([2 * 11, 3]), history_length=2)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")

    class Alone:
        reset = staticmethod(policy.reset)

        def __call__(self, observation: np.ndarray) -> np.ndarray:
            answer = policy(observation)
            return answer if observation.ndim == 1 else answer[0]  # refuses batches, but too late

    bench = client.benchmark("Hopper/simulators/gravity")
    for episodes in (3, 1, 2):
        assert len(bench.evaluate(policy, episodes=episodes).returns) == episodes
        assert len(bench.evaluate(Alone(), episodes=episodes).returns) == episodes


@pytest.mark.parametrize("shape", [(), (2,), (4,), (2, 4), (0, 3)])
def test_an_observation_of_another_size_is_refused(tmp_path: Path, shape: tuple) -> None:
    write_agent(tmp_path / "agent.h5")
    with pytest.raises(errors.InvalidArgumentError):
        b4mrl.load_agent(tmp_path / "agent.h5")(np.zeros(shape))


def test_the_agent_that_the_project_carries_runs(client: b4mrl.Client) -> None:
    policy = b4mrl.load_agent(CARRIED)
    lanes = 4
    with client.make_vec("HalfCheetah", lanes) as vec:
        observations = vec.reset(seed=0)[0]
        returns = np.zeros(lanes)
        for _ in range(1000):
            observations, rewards, *_ = vec.step(policy(observations))
            returns += rewards
        score = vec.session.spec.normalised_score(returns.mean())
    # Its training stopped at a score of 40; single episodes vary by several points.
    assert 30 < score < 55


LAYERS = [(np.zeros((6, 17)), np.zeros(6))]


@pytest.mark.parametrize("observation", ["abc", RAGGED, {}, ["a"] * 17, object()])
def test_what_is_no_observation_is_refused_by_a_policy(tmp_path: Path, observation: object) -> None:
    b4mrl.save_agent(tmp_path / "agent.h5", LAYERS)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    with pytest.raises(errors.InvalidArgumentError, match="observation is .*allowed"):
        policy(observation)
