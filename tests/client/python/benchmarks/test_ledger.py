"""Ledgers: what the daemon counts for the environments, queries and datasets that name one."""

from __future__ import annotations

import pickle

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks.ledger import LedgerCounts
from conftest import daemon


def test_a_ledger_counts_steps_and_ended_episodes(client: b4mrl.Client) -> None:
    ledger = client.ledger()
    assert ledger.counts() == LedgerCounts(0, 0, 0, 0)
    with client.make("HalfCheetah", max_episode_steps=3, ledger=ledger) as env:
        env.reset(seed=1)
        for _ in range(3):
            env.step(env.action_space.sample())
    assert ledger.counts() == LedgerCounts(3, 1, 0, 0)
    with client.make_vec("HalfCheetah", 2, max_episode_steps=3, ledger=ledger) as vec:
        vec.reset(seed=1)
        for _ in range(4):  # the last one only begins the next episodes
            vec.step(vec.action_space.sample())
    assert ledger.counts() == LedgerCounts(9, 3, 0, 0)


def test_a_ledger_counts_rows_of_queries(client: b4mrl.Client) -> None:
    ledger, other = client.ledger(), client.ledger()
    rows = np.zeros((5, 17), np.float32), np.zeros((5, 6), np.float32)
    for counted in (ledger, ledger, other, None):
        client.query("HalfCheetah", *rows, ledger=counted)
    client.query_async("HalfCheetah", *rows, ledger=ledger).result()
    assert ledger.counts() == LedgerCounts(0, 0, 15, 0)
    assert other.counts() == LedgerCounts(0, 0, 5, 0)


@pytest.mark.parametrize("rule", ["stored", "d4rl"])
def test_a_slice_without_rows_counts_none(medium: b4mrl.Client, rule: str) -> None:
    ledger = medium.ledger()
    with medium.dataset("HalfCheetah/medium", transition_rule=rule, ledger=ledger) as dataset:
        empty = [dataset[0:0], dataset[5:5], dataset[dataset.rows :], dataset[7:3]]
        assert ledger.counts() == LedgerCounts(0, 0, 0, 0)
        kinds = {name: (each[1:].shape, each.dtype) for name, each in dataset[:1].items()}
        assert ledger.counts().dataset_rows == 1
    for rows in empty:
        assert {name: (each.shape, each.dtype) for name, each in rows.items()} == kinds


def test_a_folder_that_cannot_hold_pairs_costs_no_simulation(medium: b4mrl.Client) -> None:
    ledger = medium.ledger()
    with medium.dataset("HalfCheetah/medium", ledger=ledger) as dataset:
        with pytest.raises(NotADirectoryError):
            dataset.pair("gravity", folder="/dev/null/pairs")
        with pytest.raises(errors.InvalidArgumentError, match="^simulator is .*allowed"):
            dataset.pair(3)
        for wrong in ({"pair_with": 3}, {"pair_seed": -1}, {"pair_folder": 3}):
            name = next(iter(wrong))
            with pytest.raises(errors.InvalidArgumentError, match=f"^{name} is .*allowed"):
                dataset.stream(8, **({"pair_with": "gravity"} | wrong))
    assert ledger.counts() == LedgerCounts(0, 0, 0, 0)


def test_its_number_stands_for_a_ledger_in_another_process(client: b4mrl.Client) -> None:
    ledger = client.ledger()
    with b4mrl.connect(daemon().endpoint) as another:
        with another.make("HalfCheetah", ledger=ledger.number) as env:
            env.reset(seed=1)
            env.step(env.action_space.sample())
        assert another.ledger(ledger.number).counts().steps == 1
    assert pickle.loads(pickle.dumps(ledger)).counts() == ledger.counts()


def test_copies_and_gym_make_count_in_the_same_ledger(client: b4mrl.Client) -> None:
    ledger = client.ledger()
    with client.make("HalfCheetah", ledger=ledger) as env:
        copies = pickle.loads(pickle.dumps(env)), gym.make(env.spec)
        for copy in copies:
            copy.reset(seed=1)
            copy.step(copy.action_space.sample())
            copy.close()
    assert ledger.counts().steps == 2


def test_unknown_ledgers_are_refused_by_name_and_disturb_no_environment(
    client: b4mrl.Client,
) -> None:
    with pytest.raises(errors.UnknownNameError, match="17"):
        client.ledger(17)
    with pytest.raises(errors.InvalidArgumentError, match="ledger is 'mine'"):
        client.make("HalfCheetah", ledger="mine")
    with client.make("HalfCheetah", ledger=2**64 - 1) as env:
        env.reset(seed=1)
        env.step(env.action_space.sample())
