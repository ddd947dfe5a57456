"""Pairs: what a simulator makes of each row of a dataset."""

from __future__ import annotations

import itertools
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors

from equality import assert_same
from made_dataset import EXAMPLE_ROWS, write_example


def test_a_paired_stream_has_what_the_simulator_makes_of_each_row(example) -> None:
    client, _ = example
    with b4mrl.connect(client.endpoint) as opener:
        dataset = opener.dataset("HalfCheetah/medium", corruption="hidden-low")
    with dataset:  # which does not need its client any more
        simulator = "gravity,obs-noise=0.1"
        pairs = dataset.pair(simulator, seed=3)
        rows = dataset.read(0, EXAMPLE_ROWS)
        wanted = client.query(
            "HalfCheetah", rows["observations"], rows["actions"], simulator, seed=3
        )
        np.testing.assert_array_equal(pairs["simulator_next_observations"], wanted[0])
        mine = dataset.pair(simulator, seed=3)
        for column in mine.values():
            with pytest.raises(ValueError):  # what streams take from is nobody's to change
                column.flags.writeable = True
        mine.clear()
        batches = itertools.islice(dataset.stream(64, pair_with=simulator, pair_seed=3), 3)
        for number, batch in enumerate(batches):
            indices = dataset.sample(64, batch=number, with_indices=True)["indices"]
            for name in ("next_observations", "rewards", "terminals", "valid"):
                column = pairs["simulator_" + name]
                np.testing.assert_array_equal(batch["simulator_" + name], column[indices])
            assert batch["simulator_next_observations"].dtype == np.float32
            assert batch["simulator_valid"].all()


def test_pairs_do_not_depend_on_how_the_rows_are_cut(example) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as whole, client.dataset("HalfCheetah/medium") as cut:
        for rows in (999, 2500, EXAMPLE_ROWS):
            cut._rows_per_read = rows
            found = cut.pair({"obs-noise": 0.1}, seed=rows)
            assert_same(found, whole.pair("obs-noise=0.1", seed=rows))


def test_pairs_that_were_kept_in_a_folder_are_simulated_once(
    example, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, _ = example
    simulator = "gravity,obs-noise=0.1"
    with client.dataset("HalfCheetah/medium") as dataset:
        wanted = dataset.pair(simulator, seed=2)
        kept = dataset.pair(simulator, seed=2, folder=tmp_path / "pairs")
        assert_same(kept, wanted)
        assert not kept["simulator_rewards"].flags.writeable
    with client.dataset("HalfCheetah/medium") as later:
        with monkeypatch.context() as patch:
            patch.setattr(b4mrl.query, "begin", None)  # any simulation would fail
            assert_same(later.pair(simulator, seed=2, folder=tmp_path / "pairs"), wanted)
            batch = next(
                later.stream(8, pair_with=simulator, pair_seed=2, pair_folder=tmp_path / "pairs")
            )
            assert batch["simulator_next_observations"].shape == (8, 17)
        # Another seed, simulator or corruption is another pairing.
        other_seed = later.pair(simulator, seed=3, folder=tmp_path / "pairs")
        other_simulator = later.pair("gravity", folder=tmp_path / "pairs")
    with client.dataset("HalfCheetah/medium", "hidden=9") as hidden:
        other_data = hidden.pair(simulator, seed=2, folder=tmp_path / "pairs")
    column = "simulator_next_observations"
    for other in (other_seed, other_simulator, other_data):
        assert not np.array_equal(other[column], wanted[column])
    assert len(list((tmp_path / "pairs").iterdir())) == 4


def test_pairs_are_asked_for_with_the_deadline_of_their_dataset(
    example, monkeypatch: pytest.MonkeyPatch
) -> None:
    client, _ = example
    deadlines = []

    def noted(session: object, *arguments: object, **options: object) -> object:
        deadlines.append(session.deadline_ms)
        return begin(session, *arguments, **options)

    begin = b4mrl.query.begin
    monkeypatch.setattr(b4mrl.query, "begin", noted)
    for deadline_ms in (123_456, None):
        with client.dataset("HalfCheetah/medium", deadline_ms=deadline_ms) as dataset:
            dataset.pair("gravity")
    assert deadlines == [123_456, client.deadline_ms]


def test_damaged_files_of_pairs_are_named(example, tmp_path: Path) -> None:
    client, _ = example
    with client.dataset("HalfCheetah/medium") as dataset:
        dataset.pair("gravity", folder=tmp_path)
    (column,) = tmp_path.glob("*/simulator_rewards.npy")
    for damage in (column.read_bytes()[:-8], b""):
        column.write_bytes(damage)
        with client.dataset("HalfCheetah/medium") as dataset:
            with pytest.raises(errors.DataLossError, match="simulator_rewards.npy"):
                dataset.pair("gravity", folder=tmp_path)


def test_pairs_are_those_of_the_environment_that_the_file_names(tmp_path: Path) -> None:
    for name in ("Mine/a", "Walker2d/b", "Mine/c"):
        write_example(tmp_path / f"{name}.h5")
    with h5py.File(tmp_path / "Mine" / "a.h5", "a") as file:
        file["metadata/environment"] = np.bytes_("Walker2d")
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("Mine/a") as told, client.dataset("Walker2d/b") as named:
            assert told.environment == named.environment == "Walker2d"
            assert_same(told.pair("gravity=1.5"), named.pair("gravity=1.5"))
        with client.dataset("Mine/c") as unknown:
            assert unknown.environment == ""
            with pytest.raises(errors.FailedPreconditionError, match="Mine/c.*recorded"):
                unknown.pair("gravity")
