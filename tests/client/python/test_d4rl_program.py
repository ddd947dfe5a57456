"""A made dataset, read by a program that knows D4RL's layout and nothing of this project."""

from __future__ import annotations

from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors

from equality import assert_same
from made_dataset import NAME, ROWS, make_dataset, run_dataset


# The program, in 20 lines: all arrays of a file, and the transitions that D4RL's learners use.
def get_dataset(path: Path) -> dict[str, np.ndarray]:
    arrays: dict[str, np.ndarray] = {}

    def keep(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            arrays[name] = item[()] if item.shape == () else item[:]

    with h5py.File(path, "r") as file:
        file.visititems(keep)
    return arrays


def qlearning_dataset(data: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    kept = np.flatnonzero(~data["timeouts"][:-1])
    names = ("observations", "actions", "rewards", "terminals")
    rows = {name: data[name][kept] for name in names}
    rows["next_observations"] = data["observations"][kept + 1]
    return rows


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    make_dataset(folder)
    return folder


def test_h5py_sees_the_arrays_of_d4rl_with_their_types(data: Path) -> None:
    arrays = get_dataset(data / "Hopper" / "random-v0.h5")
    for name, shape, kind in (
        ("observations", (ROWS, 11), np.float32),
        ("next_observations", (ROWS, 11), np.float32),
        ("actions", (ROWS, 3), np.float32),
        ("rewards", (ROWS,), np.float32),
        ("terminals", (ROWS,), np.bool_),
        ("timeouts", (ROWS,), np.bool_),
    ):
        assert (arrays[name].shape, arrays[name].dtype) == (shape, kind), name
    assert arrays["metadata/license"] == b"CC-BY-4.0"
    inside = ~(arrays["terminals"] | arrays["timeouts"])[:-1]
    np.testing.assert_array_equal(
        arrays["next_observations"][:-1][inside], arrays["observations"][1:][inside]
    )
    assert arrays["terminals"].sum() > 20


def test_the_programs_transitions_are_those_that_the_daemon_serves(data: Path) -> None:
    rows = qlearning_dataset(get_dataset(data / "Hopper" / "random-v0.h5"))
    with b4mrl.serve(data=data) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset(NAME, transition_rule="d4rl") as dataset:
            served = dataset.read(0, dataset.rows)
    assert_same(rows, {name: served[name].astype(rows[name].dtype) for name in rows})


def test_rows_under_the_other_rule_are_those_of_the_object_or_none(tmp_path: Path) -> None:
    run_dataset(tmp_path, "make", NAME, "--rows", "2000")
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        dataset = client.dataset(NAME)
        assert len(dataset.load("d4rl")["rewards"]) < 2_000
        run_dataset(tmp_path, "make", NAME, "--rows", "3000", "--replace")
        assert len(dataset.load()["rewards"]) == 2_000
        with pytest.raises(errors.FailedPreconditionError, match="other rows now"):
            dataset.load("d4rl")
