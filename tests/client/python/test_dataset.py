"""Datasets, from a file of this test to batches and back."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors

ROWS, EPISODE = 5_000, 100


def write_example(path: Path) -> dict[str, np.ndarray]:
    """Recognisable numbers near those that HalfCheetah has: episodes that end by time-out."""
    rng = np.random.default_rng(7)
    columns = {
        "observations": rng.normal(scale=0.1, size=(ROWS, 17)).astype(np.float32),
        "actions": rng.uniform(-1, 1, size=(ROWS, 6)).astype(np.float32),
        "rewards": np.arange(ROWS, dtype=np.float32),
        "next_observations": rng.normal(scale=0.1, size=(ROWS, 17)).astype(np.float32),
        "terminals": np.zeros(ROWS, bool),
        "timeouts": np.arange(ROWS) % EPISODE == EPISODE - 1,
    }
    path.parent.mkdir(parents=True)
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        for name, column in columns.items():
            file[name] = column
    return columns


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[b4mrl.Client, dict]]:
    folder = tmp_path_factory.mktemp("data")
    columns = write_example(folder / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=folder) as endpoint, b4mrl.connect(endpoint) as client:
        yield client, columns


def test_a_dataset_is_listed_and_read_as_it_was_written(example) -> None:
    client, columns = example
    assert "HalfCheetah/medium" in [info.name for info in client.datasets()]
    with client.dataset("HalfCheetah/medium") as dataset:
        assert (dataset.rows, dataset.observation_size, dataset.action_size) == (ROWS, 17, 6)
        assert dataset.in_force.info.rows == ROWS
        rows = dataset.read(10, 50)
        assert rows.keys() == columns.keys()
        for name, column in rows.items():
            np.testing.assert_array_equal(column, columns[name][10:60])
        assert len(dataset.read(ROWS - 3, 50)["rewards"]) == 3


def test_a_batch_holds_the_rows_that_its_indices_name(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium") as dataset:
        batch = dataset.sample(256, seed=1, with_indices=True)
        indices = batch.pop("indices")
        assert len(np.unique(indices)) > 200
        for name, column in batch.items():
            np.testing.assert_array_equal(column, columns[name][indices])
            assert column.flags.writeable


def test_a_batch_is_a_function_of_its_seed_and_number(example) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as one, client.dataset("HalfCheetah/medium") as two:
        first = [one.sample(32)["rewards"] for _ in range(3)]
        assert not np.array_equal(first[0], first[1])
        np.testing.assert_array_equal(two.sample(32, batch=2)["rewards"], first[2])
        np.testing.assert_array_equal(two.sample(32, batch=0)["rewards"], first[0])
        np.testing.assert_array_equal(two.sample(32)["rewards"], first[1])
        assert not np.array_equal(two.sample(32, batch=0, seed=1)["rewards"], first[0])
        stream = two.stream(32, first_batch=1)
        for wanted in first[1:]:
            np.testing.assert_array_equal(next(stream)["rewards"], wanted)
        stream.close()
        assert two._connection._pending == {}


def test_statistics_are_those_of_the_served_data(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium", corruption="hidden=9+10") as dataset:
        stats = dataset.stats()
        wanted = columns["observations"].astype(np.float64)
        wanted[:, [9, 10]] = 0
        # Sums in another order than numpy's.
        np.testing.assert_allclose(stats.observation_mean, wanted.mean(0), atol=1e-12)
        np.testing.assert_allclose(stats.observation_std, wanted.std(0), atol=1e-12)
        returns = columns["rewards"].reshape(-1, EPISODE).sum(1, dtype=np.float64)
        assert (stats.rows, stats.episodes) == (ROWS, ROWS // EPISODE)
        assert stats.mean_return == pytest.approx(returns.mean())
        assert (stats.min_reward, stats.max_reward) == (0, ROWS - 1)
        assert list(dataset.in_force.hidden_dimensions) == [9, 10]


def test_a_paired_stream_has_what_the_simulator_makes_of_each_row(example) -> None:
    client, _ = example
    with b4mrl.connect(client.endpoint) as opener:
        dataset = opener.dataset("HalfCheetah/medium", corruption="hidden-low")
    with dataset:  # which does not need its client any more
        simulator = "gravity,obs-noise=0.1"
        pairs = dataset.pair(simulator, seed=3)
        rows = dataset.read(0, ROWS)
        wanted = client.query(
            "HalfCheetah", rows["observations"], rows["actions"], simulator, seed=3
        )
        np.testing.assert_array_equal(pairs["simulator_next_observations"], wanted[0])
        batches = itertools.islice(dataset.stream(64, pair_with=simulator, pair_seed=3), 3)
        for number, batch in enumerate(batches):
            indices = dataset.sample(64, batch=number, with_indices=True)["indices"]
            for name in ("next_observations", "rewards", "terminals", "valid"):
                column = pairs["simulator_" + name]
                np.testing.assert_array_equal(batch["simulator_" + name], column[indices])
            assert batch["simulator_next_observations"].dtype == np.float32
            assert batch["simulator_valid"].all()


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ({"name": "HalfCheetah/mediun"}, errors.UnknownNameError),
        ({"corruption": "gravity"}, errors.B4mrlError),
        ({"transition_rule": "neither"}, errors.B4mrlError),
        ({"seed": -1}, errors.InvalidArgumentError),
    ],
)
def test_what_cannot_be_opened_is_refused(example, arguments, kind) -> None:
    client, _ = example
    with pytest.raises(kind):
        client.dataset(**({"name": "HalfCheetah/medium"} | arguments))


@pytest.mark.parametrize("rows", [0, 100_000, -1])
def test_a_batch_that_cannot_be_is_refused(example, rows) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        with pytest.raises(errors.B4mrlError):
            dataset.sample(rows)
        with pytest.raises(errors.B4mrlError):
            next(dataset.stream(rows))
        assert len(dataset.sample(4)["rewards"]) == 4
