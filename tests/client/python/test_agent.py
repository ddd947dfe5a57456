"""Agents: the arithmetic against a plain formula, and the one that the project carries."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.serve import find_server

from made_dataset import run_dataset

CARRIED = Path(__file__).parents[3] / "data" / "agents" / "halfcheetah-medium.h5"
SIZE, ACTIONS, HIDDEN = 3, 2, 5

RAGGED = [[1], [1, 2]]  # no array


def write_agent(path: Path, history: int = 1, **changes: object) -> dict:
    rng = np.random.default_rng(3)
    entries = {
        "nonlinearity": b"relu",
        "output_distribution": b"tanh",
        "history_length": history,
        "observation_mask": np.array([1, 0, 1]),
        "observation_mean": rng.normal(size=SIZE),
        "observation_std": rng.uniform(0.5, 2, size=SIZE),
        "action_scale": np.array([0.4, 2.0]),
        "fc0/weight": rng.normal(size=(HIDDEN, SIZE * history)),
        "fc0/bias": rng.normal(size=HIDDEN),
        "last_fc/weight": rng.normal(size=(ACTIONS, HIDDEN)),
        "last_fc/bias": rng.normal(size=ACTIONS),
    } | changes
    with h5py.File(path, "w") as file:
        file["metadata/environment"] = b"HalfCheetah"
        for name, value in entries.items():
            if value is not None:
                file[f"metadata/policy/{name}"] = value
    return entries


def formula(entries: dict, observations: list[np.ndarray], activation: str = "relu") -> np.ndarray:
    """The action for a history of observations, oldest first, in float64."""
    layers = sum(name.startswith("fc") and name.endswith("weight") for name in entries)
    rows = []
    for observation in observations:
        row = (observation - entries["observation_mean"]) / entries["observation_std"]
        rows.append(row * entries["observation_mask"])
    hidden = np.concatenate(rows)
    for layer in range(layers):
        hidden = entries[f"fc{layer}/weight"] @ hidden + entries[f"fc{layer}/bias"]
        hidden = np.maximum(hidden, 0) if activation == "relu" else np.tanh(hidden)
    output = entries["last_fc/weight"] @ hidden + entries["last_fc/bias"]
    return entries["action_scale"] * np.tanh(output)


# Float32 against float64 over a dozen operations on numbers near 1.
TOLERANCE = 1e-5


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
    with pytest.raises(OSError, match="truncated"):
        b4mrl.load_agent(path)


def test_a_file_that_is_no_agent_is_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(errors.DataLossError, match="holds no agent"):
        b4mrl.load_agent(tmp_path / "other.h5")
    with pytest.raises(OSError):
        b4mrl.load_agent(tmp_path / "absent.h5")


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


def evaluate(agent: Path) -> subprocess.CompletedProcess[str]:
    """`b4mrl evaluate --json` of one episode."""
    command = [Path(find_server()[0]).with_name("b4mrl-tools"), "evaluate", "--json"]
    command += ["--environment", "HalfCheetah", "--episodes", "1", "--agent", agent]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def run_evaluate(agent: Path) -> dict:
    """What `b4mrl evaluate --json` prints for one episode."""
    done = evaluate(agent)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def random_layers(sizes: list[int]) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(5)
    return [
        (rng.normal(size=(outputs, inputs)) / inputs**0.5, rng.normal(size=outputs))
        for inputs, outputs in zip(sizes, sizes[1:])
    ]


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


@pytest.mark.parametrize("activation", ["relu", "tanh"])
def test_the_programs_act_by_a_saved_agent_as_python_does(tmp_path: Path, activation: str) -> None:
    path = tmp_path / "agent.h5"
    given = {"environment": "HalfCheetah", "mask": np.arange(17) != 9}
    b4mrl.save_agent(path, random_layers([17, 32, 32, 32, 6]), activation, **given)
    assert run_evaluate(path)["lengths"] == [1000]
    # A dataset is recorded by stochastic policies alone: this one's noise is exp(-20) of a normal.
    with h5py.File(path, "a") as file:
        policy = file["metadata/policy"]
        policy["last_fc_log_std/weight"] = np.zeros((6, 32), np.float32)
        policy["last_fc_log_std/bias"] = np.full(6, -20, np.float32)
        del policy["output_distribution"]
        policy["output_distribution"] = "tanh_gaussian"
    run_dataset(tmp_path / "data", "make", "HalfCheetah/mine", "--agent", path, "--rows", "10000")
    with b4mrl.serve(data=tmp_path / "data") as endpoint, b4mrl.connect(endpoint) as client:
        rows = client.dataset("HalfCheetah/mine").load()
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
        ({"layers": [(np.zeros((2, 5000)), np.zeros(2))]}, "4096"),
        ({"layers": random_layers([3, 1025])}, r"1\.\.1024"),
        ({"layers": [(np.full((2, 3), np.nan), np.zeros(2))]}, "finite"),
        ({"mask": np.ones(4)}, "3, all of them finite"),
        ({"observation_std": np.zeros(3)}, "above 0"),
        ({"observation_mean": [0, 0, np.inf]}, "finite"),
        ({"action_scale": [1.0]}, "2, all"),
        ({"history_length": 2}, "a divisor of the first layer's 3 inputs"),
    ],
)
def test_what_no_agent_file_can_hold_is_refused_with_what_is_allowed(
    tmp_path: Path, changes: dict, allowed: str
) -> None:
    given = {"layers": random_layers([3, 5, 2])} | changes
    with pytest.raises(errors.InvalidArgumentError, match=allowed):
        b4mrl.save_agent(tmp_path / "agent.h5", **given)
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
