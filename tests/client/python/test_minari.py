"""Exports to Minari, read by Minari, and a dataset of Minari's own, imported."""

from __future__ import annotations

import warnings
from pathlib import Path

import b4mrl
import gymnasium as gym
import h5py
import numpy as np
import pytest

from made_dataset import NAME, ROWS, make_dataset, run_dataset

for package in ("minari", "PIL"):  # Minari imports PIL without asking for it
    pytest.importorskip(package, reason=f"{package} is not installed")

import minari  # noqa: E402
from minari.data_collector import EpisodeBuffer  # noqa: E402

ID = "b4mrl/Hopper/random-v0"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("data")
    make_dataset(data)
    run_dataset(data, "export", NAME, data / "minari", "--format", "minari")
    return data


@pytest.fixture
def exported(made: Path, monkeypatch: pytest.MonkeyPatch) -> minari.MinariDataset:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(made / "minari"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return minari.load_dataset(ID)


def test_its_episodes_are_those_of_the_file(made: Path, exported: minari.MinariDataset) -> None:
    with h5py.File(made / "Hopper" / "random-v0.h5") as file:
        ends = np.flatnonzero(file["terminals"][:] | file["timeouts"][:]) + 1
        starts = np.unique(np.concatenate([[0], ends[ends < ROWS]]))
        assert (len(exported), exported.total_steps) == (len(starts), ROWS)
        for episode, rows in zip(exported, map(slice, starts, [*starts[1:], ROWS]), strict=True):
            pairs = (
                (episode.observations[:-1], file["observations"]),
                (episode.observations[1:], file["next_observations"]),
                (episode.actions, file["actions"]),
                (episode.rewards, file["rewards"]),
                (episode.terminations, file["terminals"]),
            )
            for given, column in pairs:
                assert given.dtype == column.dtype
                assert given.tobytes() == column[rows].tobytes()
            ended = episode.terminations | episode.truncations
            assert ended[-1] and not ended[:-1].any()
            assert f"total_steps={len(episode)}" in repr(episode)
    # The file ends before its last episode does.
    assert not episode.terminations[-1] and "truncated" in exported.storage.metadata["description"]


def test_minari_lists_it_samples_it_and_scores_it(exported: minari.MinariDataset) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(minari.list_local_datasets()) == [ID]
    for episode in exported.sample_episodes(5):
        assert all(row in exported.observation_space for row in episode.observations)
        assert all(action in exported.action_space for action in episode.actions)
    scores = minari.get_normalized_score(exported, np.array([-20.272305, 3234.3]))
    np.testing.assert_allclose(scores, [0, 1], atol=1e-12)


def test_it_recovers_its_environment(exported: minari.MinariDataset) -> None:
    env = exported.recover_environment()
    assert isinstance(env.unwrapped, b4mrl.Environment)
    assert env.observation_space.shape == exported.observation_space.shape
    np.testing.assert_array_equal(env.action_space.low, exported.action_space.low)
    observation, _ = env.reset(seed=0)
    env.step(exported[0].actions[0])
    assert observation.shape == exported[0].observations[0].shape
    env.close()


def test_a_dataset_that_minari_wrote_is_imported(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    rng = np.random.default_rng(0)
    lengths = (7, 1, 12)
    buffers = [
        EpisodeBuffer(
            observations=list(rng.normal(size=(rows + 1, 11))),
            actions=list(rng.uniform(-1, 1, size=(rows, 3)).astype(np.float32)),
            rewards=list(rng.normal(size=rows)),
            terminations=[False] * (rows - 1) + [rows != 1],
            truncations=[False] * (rows - 1) + [rows == 1],
        )
        for rows in lengths
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of authors that are not named
        minari.create_dataset_from_buffers(
            "test/hopper-v0",
            buffers,
            observation_space=gym.spaces.Box(-np.inf, np.inf, (11,), np.float64),
            action_space=gym.spaces.Box(-1, 1, (3,), np.float32),
            algorithm_name="noise",
        )
    data = tmp_path / "data"
    run_dataset(data, "import", tmp_path / "minari/test/hopper-v0", "--name", "Hopper/minari")
    with b4mrl.serve(data=data) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("Hopper/minari") as dataset:
            served = dataset.read(0, dataset.rows)
            assert dataset.in_force.info.behaviour_policy == "noise"
    whole = {
        "observations": np.concatenate([np.array(b.observations)[:-1] for b in buffers]),
        "next_observations": np.concatenate([np.array(b.observations)[1:] for b in buffers]),
        "actions": np.concatenate([np.array(b.actions) for b in buffers]),
        "rewards": np.concatenate([b.rewards for b in buffers]),
    }
    for name, column in whole.items():
        np.testing.assert_array_equal(served[name], column.astype(np.float32), err_msg=name)
    assert list(np.flatnonzero(served["timeouts"])) == [7]
    assert list(np.flatnonzero(served["terminals"])) == [6, 19]
