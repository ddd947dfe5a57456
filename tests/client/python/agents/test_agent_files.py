"""Agents' files of others: what is read, and what is refused here as by the programs."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors

from made_agents import (
    ACTIONS,
    CARRIED,
    HIDDEN,
    SIZE,
    TOLERANCE,
    evaluate,
    formula,
    random_layers,
    run_evaluate,
    write_agent,
)


def test_a_file_of_d4rl_without_our_entries_has_their_defaults(tmp_path: Path) -> None:
    ours = ("observation_mask", "observation_mean", "observation_std", "action_scale")
    absent = dict.fromkeys((*ours, "history_length"))
    noise = {"last_fc_log_std/weight": np.ones((ACTIONS, HIDDEN)), "last_fc_log_std/bias": [1, 2]}
    gaussian = {"output_distribution": b"tanh_gaussian"} | noise
    entries = write_agent(tmp_path / "agent.h5", **absent, **gaussian)
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    plain = {"observation_mean": 0, "observation_std": 1, "observation_mask": 1, "action_scale": 1}
    observation = np.array([0.1, 0.2, 0.3])
    wanted = formula(entries | plain, [observation])
    np.testing.assert_allclose(policy(observation), wanted, atol=TOLERANCE)


@pytest.mark.parametrize(
    "changes",
    [
        {"nonlinearity": b"gelu"},
        {"output_distribution": b"normal"},
        {"last_fc/bias": np.zeros(3)},
        {"last_fc/weight": None},
        {"last_fc/weight": np.zeros((ACTIONS, HIDDEN + 1))},
        {"observation_mean": np.zeros(4)},
        {"history_length": 2},
        {"history_length": 0},
        {"fc0/weight": np.full((HIDDEN, SIZE), np.nan)},
    ],
)
def test_an_inconsistent_file_is_refused(tmp_path: Path, changes: dict) -> None:
    write_agent(tmp_path / "agent.h5", **changes)
    with pytest.raises(errors.DataLossError):
        b4mrl.load_agent(tmp_path / "agent.h5")


def edited_agent(path: Path, entry: str, value: object) -> None:
    """An agent of HalfCheetah with another value for an entry of its `metadata`; None: without it.

    A function makes the entry: it is called with the file and the entry's path.
    """
    b4mrl.save_agent(path, random_layers([17, HIDDEN, 6]), environment="HalfCheetah")
    entry = f"metadata/{entry}"
    with h5py.File(path, "a") as file:
        if entry in file:
            del file[entry]
        if callable(value):
            value(file, entry)
        elif value is not None:
            file[entry] = value


def group(file: h5py.File, entry: str) -> None:
    file.create_group(entry)


def unwritten(*shape: int) -> Callable[[h5py.File, str], None]:
    """Makes an array of which no number is stored."""
    return lambda file, entry: file.create_dataset(entry, shape, "f4", chunks=(6, 5))


def in_another_file(file: h5py.File, entry: str) -> None:
    file[entry] = h5py.ExternalLink(str(CARRIED), "metadata/policy/last_fc/weight")


def compressed_by_lzf(file: h5py.File, entry: str) -> None:
    file.create_dataset(entry, data=np.zeros((6, HIDDEN)), compression="lzf")


def described(value: object) -> str:
    return getattr(value, "__name__", str(value).replace("\n", ""))[:20]


MALFORMED = [
    ("environment", group),
    ("environment", 3),
    ("environment", np.array([b"Hopper", b"Ant"])),
    ("algorithm", "x" * 70_000),
    ("seed", "-1"),
    ("seed", 3),
    ("iteration", "many"),
    ("iteration", -1),
    ("iteration", 2.5),
    ("command", [1, 2]),
    ("policy", np.zeros(3)),
    ("policy/nonlinearity", np.array([1, 2])),
    ("policy/nonlinearity", None),
    ("policy/output_distribution", "tanh_gaussian"),  # without the layer of its deviations
    ("policy/fc0", np.zeros(3)),
    ("policy/fc0/weight", unwritten(60_000, 17)),
    ("policy/fc0/weight", unwritten(4096, 4096)),
    ("policy/fc0/weight", np.full((HIDDEN, 17), 1e300)),
    ("policy/last_fc", None),
    ("policy/last_fc/weight", group),
    ("policy/last_fc/weight", "abc"),
    ("policy/last_fc/weight", np.zeros((6, HIDDEN), np.float16)),
    ("policy/last_fc/weight", np.zeros((6, HIDDEN), np.complex64)),
    ("policy/last_fc/weight", np.zeros((6, HIDDEN, 1))),
    ("policy/last_fc/weight", h5py.Empty("f4")),
    ("policy/last_fc/weight", in_another_file),
    ("policy/last_fc/weight", compressed_by_lzf),
    ("policy/last_fc/bias", np.zeros(0)),
    ("policy/last_fc/bias", np.full(6, np.inf)),
    ("policy/history_length", np.array([1, 2])),
    ("policy/history_length", "x"),
    ("policy/history_length", np.nan),
    ("policy/history_length", 17 * 17),
    ("policy/history_length", 1.5),
    ("policy/observation_mask", "abc"),
    ("policy/observation_mask", np.ones(16)),
    ("policy/observation_mean", np.full(17, np.nan)),
    ("policy/observation_std", np.zeros(17)),
    ("policy/observation_std", np.full(17, np.inf)),
    ("policy/action_scale", np.full(6, np.inf)),
]


@pytest.mark.parametrize(("entry", "value"), MALFORMED, ids=described)
def test_a_malformed_entry_is_named_here_and_refused_by_the_programs(
    tmp_path: Path, entry: str, value: object
) -> None:
    path = tmp_path / "agent.h5"
    edited_agent(path, entry, value)
    named = "last_fc_log_std" if entry.endswith("distribution") else f"metadata/{entry}"
    with pytest.raises(errors.DataLossError, match=named):
        b4mrl.load_agent(path)
    done = evaluate(path)
    assert done.returncode != 0
    assert "metadata" in done.stderr or "agent" in done.stderr


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("environment", None),
        ("seed", ""),
        ("command", b"train --data /tmp/\xff"),
        ("policy/last_fc/bias", np.zeros((6, 1), np.int8)),
        ("policy/history_length", np.array([[1.0]])),
        ("policy/observation_mask", np.arange(17, dtype=np.uint64)),
        ("policy/observation_mean", np.zeros(0)),
        ("policy/observation_std", np.ones((1, 17), ">f8")),
        ("policy/action_scale", h5py.SoftLink("/metadata/policy/observation_mean")),  # not followed
    ],
    ids=described,
)
def test_an_unusual_entry_is_read_here_and_by_the_programs(
    tmp_path: Path, entry: str, value: object
) -> None:
    path = tmp_path / "agent.h5"
    edited_agent(path, entry, value)
    assert b4mrl.load_agent(path)(np.zeros(17)).shape == (6,)
    run_evaluate(path)


def test_a_layer_too_many_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "agent.h5"
    b4mrl.save_agent(path, random_layers([3] * 18))
    with h5py.File(path, "a") as file:
        file.copy("metadata/policy/fc0", "metadata/policy/fc16")
    with pytest.raises(errors.DataLossError, match=r"17 hidden layers or more, allowed: 0\.\.16"):
        b4mrl.load_agent(path)


def test_a_layer_that_is_missing_between_others_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "agent.h5"
    b4mrl.save_agent(path, random_layers([3] * 4))
    with h5py.File(path, "a") as file:
        file.copy("metadata/policy/fc0", "metadata/policy/fc3")
    with pytest.raises(errors.DataLossError, match="metadata/policy/fc3 is there without fc2"):
        b4mrl.load_agent(path)


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "agent.h5"
    b4mrl.save_agent(path, random_layers([17, 256, 6]))
    path.write_bytes(path.read_bytes()[:-10_000])
    with pytest.raises(OSError, match=f"^{path} cannot be read: .*truncated"):
        b4mrl.load_agent(path)


def test_a_file_that_is_no_agent_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(errors.DataLossError, match="holds no agent"):
        b4mrl.load_agent(tmp_path / "other.h5")
    absent = tmp_path / "absent.h5"
    with pytest.raises(FileNotFoundError, match=rf"No such file or directory: '{absent}'"):
        b4mrl.load_agent(absent)


def test_texts_may_be_as_h5py_writes_them_here_and_for_the_command(tmp_path: Path) -> None:
    """Of variable length, unless it is told otherwise."""
    own = tmp_path / "own.h5"
    shutil.copy(CARRIED, own)
    with h5py.File(own, "a") as file:
        for name in ("environment", "policy/nonlinearity", "policy/output_distribution"):
            value = file["metadata"][name][()].decode()
            del file["metadata"][name]
            file["metadata"][name] = value
            assert h5py.check_string_dtype(file["metadata"][name].dtype).length is None
    observations = np.random.default_rng(0).normal(size=(4, 17))
    actions = [b4mrl.load_agent(path)(observations) for path in (CARRIED, own)]
    np.testing.assert_array_equal(*actions)
    answers = [run_evaluate(path) | {"agent": None} for path in (CARRIED, own)]
    assert answers[0] == answers[1]
