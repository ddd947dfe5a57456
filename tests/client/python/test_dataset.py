"""Datasets, from a file of this test to batches and back."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks.ledger import LedgerCounts
from b4mrl.wire import limits
from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery

from conftest import in_a_child
from equality import assert_same
from made_dataset import EXAMPLE_EPISODE, EXAMPLE_ROWS, write_example


def test_a_dataset_is_listed_and_read_as_it_was_written(example) -> None:
    client, columns = example
    assert "HalfCheetah/medium" in [info.name for info in client.datasets()]
    with client.dataset("HalfCheetah/medium") as dataset:
        assert (dataset.rows, dataset.observation_size, dataset.action_size) == (
            EXAMPLE_ROWS,
            17,
            6,
        )
        assert dataset.in_force.info.rows == EXAMPLE_ROWS
        rows = dataset.read(10, 50)
        assert rows.keys() == columns.keys()
        for name, column in rows.items():
            np.testing.assert_array_equal(column, columns[name][10:60])
        assert len(dataset.read(EXAMPLE_ROWS - 3, 50)["rewards"]) == 3


def test_rows_and_queries_of_pairs_are_counted_in_the_ledger_of_the_dataset(example) -> None:
    client, _ = example
    ledger = client.ledger()
    with client.dataset("HalfCheetah/medium", ledger=ledger) as dataset:
        dataset.sample(256)
        dataset.read(10, 50)
        assert ledger.counts() == LedgerCounts(0, 0, 0, 306)
        with copy.copy(dataset) as another:
            another.sample(4)
        assert ledger.counts().dataset_rows == 310
        dataset.pair("gravity")  # reads every row and simulates one step from it
        assert ledger.counts() == LedgerCounts(0, 0, EXAMPLE_ROWS, 310 + EXAMPLE_ROWS)


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
        two.sample(32, batch=2**64 - 1)  # the last one
        for batch in (None, 2**64):
            with pytest.raises(errors.InvalidArgumentError, match=f"batch is {2**64}, allowed"):
                two.sample(32, batch=batch)
        stream = two.stream(32, first_batch=1)
        for wanted in first[1:]:
            np.testing.assert_array_equal(next(stream)["rewards"], wanted)
        stream.close()
        assert two._connection._pending == {}


def test_interrupted_samples_leave_room_for_others(
    example, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        wanted = dataset.sample(32, batch=0)
        with monkeypatch.context() as patch:
            patch.setattr("b4mrl.wire.connection.Connection.await_any", interrupted)
            for _ in range(limits.MAX_REQUESTS_IN_FLIGHT + 1):
                with pytest.raises(KeyboardInterrupt):
                    dataset.sample(32, batch=0)
        assert_same(dataset.sample(32, batch=0), wanted)


def test_statistics_are_those_of_the_served_data(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium", corruption="hidden=9+10") as dataset:
        stats = dataset.stats()
        wanted = columns["observations"].astype(np.float64)
        wanted[:, [9, 10]] = 0
        # Sums in another order than numpy's.
        np.testing.assert_allclose(stats.observation_mean, wanted.mean(0), atol=1e-12)
        np.testing.assert_allclose(stats.observation_std, wanted.std(0), atol=1e-12)
        returns = columns["rewards"].reshape(-1, EXAMPLE_EPISODE).sum(1, dtype=np.float64)
        assert (stats.rows, stats.episodes) == (EXAMPLE_ROWS, EXAMPLE_ROWS // EXAMPLE_EPISODE)
        assert stats.mean_return == pytest.approx(returns.mean())
        assert (stats.min_reward, stats.max_reward) == (0, EXAMPLE_ROWS - 1)
        assert list(dataset.in_force.hidden_dimensions) == [9, 10]


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ({"name": "HalfCheetah/mediun"}, errors.UnknownNameError),
        ({"name": "halfcheetah-medium-v2"}, errors.UnknownNameError),
        ({"name": None}, errors.InvalidArgumentError),
        ({"transition_rule": None}, errors.InvalidArgumentError),
        ({"environment": 3}, errors.InvalidArgumentError),
        ({"corruption": "gravity"}, errors.B4mrlError),
        ({"transition_rule": "neither"}, errors.B4mrlError),
        ({"seed": -1}, errors.InvalidArgumentError),
    ],
)
def test_what_cannot_be_opened_is_refused(example, arguments, kind) -> None:
    client, _ = example
    with pytest.raises(kind) as caught:
        client.dataset(**({"name": "HalfCheetah/medium"} | arguments))
    assert ("`b4mrl dataset make " in str(caught.value)) == (
        arguments.get("name") == "HalfCheetah/mediun"
    )


@pytest.mark.parametrize("rows", [0, 100_000, -1])
def test_a_batch_that_cannot_be_is_refused(example, rows) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        with pytest.raises(errors.InvalidArgumentError, match="allowed: an integer in 1..65536"):
            dataset.sample(rows)
        with pytest.raises(errors.InvalidArgumentError, match="^rows is .*1..65536"):
            dataset.stream(rows)
        assert len(dataset.sample(4)["rewards"]) == 4


@pytest.mark.parametrize("name", ["seed", "first_batch", "credits"])
def test_a_stream_that_cannot_be_is_refused_before_its_first_batch(example, name) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        with pytest.raises(errors.InvalidArgumentError, match=f"^{name} is -1"):
            dataset.stream(8, **{name: -1})


def test_it_loads_slices_and_counts_like_a_list(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium") as dataset:
        assert len(dataset) == EXAMPLE_ROWS
        for rows in (slice(None), slice(10, 60), slice(-3, None), slice(7, 7), slice(9, 3)):
            assert_same(dataset[rows], {name: each[rows] for name, each in columns.items()})
        assert_same(dataset.load(), columns)
        for wrong in (3, slice(0, 10, 2), slice("a"), "rewards"):
            with pytest.raises(errors.InvalidArgumentError, match="allowed: a slice"):
                dataset[wrong]
        for wrong in ((-1, 5), (EXAMPLE_ROWS, 1), (0, 0), (0, -1), (0.5, 1)):
            with pytest.raises(errors.InvalidArgumentError, match="integer (in 0..4999|of at le)"):
                dataset.read(*wrong)


def test_episodes_are_the_rows_up_to_each_end(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium") as dataset:
        dataset._rows_per_read = 37  # so that episodes lie across replies, and begin with one
        episodes = list(dataset.episodes())
    assert len(episodes) == EXAMPLE_ROWS // EXAMPLE_EPISODE
    for i, episode in enumerate(episodes):
        rows = slice(i * EXAMPLE_EPISODE, (i + 1) * EXAMPLE_EPISODE)
        assert_same(episode, {name: column[rows] for name, column in columns.items()})


def test_an_episode_ends_by_either_flag_and_the_last_one_may_be_open(tmp_path: Path) -> None:
    def change(columns: dict[str, np.ndarray]) -> None:
        columns["timeouts"][:] = False
        columns["timeouts"][99] = True
        columns["terminals"][[0, 3000]] = True

    write_example(tmp_path / "HalfCheetah" / "ends.h5", change)
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/ends") as dataset:
            lengths = [len(episode["rewards"]) for episode in dataset.episodes()]
    assert lengths == [1, 99, 2901, EXAMPLE_ROWS - 3001]


def test_what_does_not_fit_one_reply_comes_in_parts(tmp_path: Path, long: bool) -> None:
    """Humanoid's rows have 3,082 bytes, so that 64 MiB hold fewer than 65,536 of them."""
    rows = 21_800
    rng = np.random.default_rng(1)
    columns = {
        "observations": rng.normal(scale=0.01, size=(rows, 376)).astype(np.float32),
        "actions": np.zeros((rows, 17), np.float32),
        "rewards": np.arange(rows, dtype=np.float32),
        "next_observations": rng.normal(size=(rows, 376)).astype(np.float32),
        "terminals": np.zeros(rows, bool),
        "timeouts": np.zeros(rows, bool),
    }
    columns["observations"][:, :2] += (1.4, 1)  # upright: what lies in the floor takes long
    (tmp_path / "Humanoid").mkdir()
    with h5py.File(tmp_path / "Humanoid" / "wide.h5", "w", libver=("earliest", "v110")) as file:
        for name, column in columns.items():
            file[name] = column
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("Humanoid/wide") as dataset:
            assert sum(column.nbytes for column in columns.values()) > limits.MAX_PAYLOAD_BYTES
            assert_same(dataset.load(), columns)
            assert_same(dataset[-5:], {name: each[-5:] for name, each in columns.items()})
            if long:  # Humanoid is slow to simulate
                pairs = dataset.pair("action-noise=0.1")
                assert pairs["simulator_next_observations"].shape == (rows, 376)
                assert pairs["simulator_valid"].all()


def test_a_long_read_comes_in_small_replies_of_which_eight_are_under_way(
    example, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that over a slow link each of them comes before its request would be sent again."""
    client, columns = example
    under_way, payloads = [], []
    receive = Connection.receive_any

    def watch(connection: Connection, request_ids: tuple[int, ...]) -> Delivery:
        under_way.append(len(connection._pending) + len(connection._arrived))
        delivery = receive(connection, request_ids)
        payloads.append(len(delivery.payload))
        return delivery

    monkeypatch.setattr("b4mrl.dataset._READ_BYTES", 1 << 15)
    with client.dataset("HalfCheetah/medium") as dataset:
        monkeypatch.setattr(Connection, "receive_any", watch)
        assert_same(dataset.load(), columns)
    assert max(under_way) == 8
    assert (1 << 14) < max(payloads) <= 1 << 15


def test_a_file_says_where_its_rows_come_from(tmp_path: Path) -> None:
    write_example(tmp_path / "HalfCheetah" / "partial.h5")
    with h5py.File(tmp_path / "HalfCheetah" / "partial.h5", "a") as file:
        for name, text in {
            "environment": "HalfCheetah",
            "hidden": "9,16",
            "policies": "SAC;TD3",
            "policies_sha256": "ab,cd",
            "seeds": "3,4",
            "rows": "1000,4000",
        }.items():
            file[f"metadata/recording/{name}"] = np.bytes_(text)
        for name in ("observations", "next_observations"):
            file[name][:, 9] = file[name][:, 16] = 0
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset(
            "HalfCheetah/partial", "hidden=1", environment="HalfCheetah"
        ) as dataset:
            assert dataset.hidden_dimensions == (1, 9, 16)
            provenance = dataset.in_force.provenance
            assert provenance.hidden_dimensions == (9, 16)
            assert [part.policy for part in provenance.parts] == ["SAC", "TD3"]
            assert [part.seed for part in provenance.parts] == [3, 4]
            assert len(dataset.in_force.info.columns_sha256) == 64
            assert dataset.in_force.transition_rule == "stored"
        with pytest.raises(errors.InvalidArgumentError, match="recorded in HalfCheetah, not in W"):
            client.dataset("HalfCheetah/partial", environment="Walker2d")


@pytest.mark.parametrize(
    "make_copy", [copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it))], ids=["copy", "pickle"]
)
def test_a_copied_dataset_serves_the_same(example, make_copy) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium", {"hidden": [9, 10]}, seed=3) as dataset:
        dataset.sample(4)
        with make_copy(dataset) as twin:
            assert twin.in_force == dataset.in_force
            assert_same(twin.sample(32), dataset.sample(32, batch=0))
        assert len(dataset.sample(4)["rewards"]) == 4


def test_a_dataset_survives_a_fork(example) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        wanted = dataset.sample(32, seed=5, batch=0)
        assert_same(in_a_child(lambda: next(dataset.stream(32, seed=5))), wanted)
        assert len(dataset.sample(4)["rewards"]) == 4  # the parent's goes on


def test_streams_and_episodes_go_on_on_both_sides_of_a_fork(example) -> None:
    client, columns = example
    with client.dataset("HalfCheetah/medium") as dataset:
        stream, episodes = dataset.stream(32), dataset.episodes()
        next(stream)
        next(episodes)
        batches = [dataset.sample(32, batch=batch) for batch in (1, 2)]
        second = slice(EXAMPLE_EPISODE, 2 * EXAMPLE_EPISODE)
        episode = {name: column[second] for name, column in columns.items()}
        found = in_a_child(lambda: ([next(stream), next(stream)], next(episodes)))
        assert_same(found, (batches, episode))
        assert_same(([next(stream), next(stream)], next(episodes)), (batches, episode))


def test_a_dataset_says_what_it_is(example) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium", "hidden=9+10") as dataset:
        assert repr(dataset) == (
            "<Dataset name='HalfCheetah/medium', environment='HalfCheetah', "
            "corruption='hidden=9+10', rows=5000, observation_size=17, action_size=6>"
        )
        assert dataset.corruption == "hidden=9+10"
        assert "hidden=9+10" in dataset._repr_html_()
        assert "rows=5000" in repr(dataset.stats())
    (info,) = client.datasets()
    assert (info.name, info.rows) == ("HalfCheetah/medium", EXAMPLE_ROWS)


def test_the_number_of_the_next_batch_does_not_overflow_in_the_callers_type(example) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        dataset.sample(4, batch=np.uint8(255))
        following = dataset.sample(4)
        assert_same(following, dataset.sample(4, batch=256))
