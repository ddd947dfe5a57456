"""Benchmarks by name, without a client, and in a program that the runner starts."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks.ledger import LedgerCounts
from b4mrl.serve import find_server

from made_dataset import run_dataset
from test_benchmark import HIDDEN, still
from test_documents import ROOT, program_with

EXAMPLES = ROOT / "client" / "examples"


@pytest.fixture
def own(medium: b4mrl.Client, monkeypatch: pytest.MonkeyPatch) -> b4mrl.Client:
    """The client of the daemon that b4mrl.benchmark and b4mrl.suite find."""
    monkeypatch.setenv("B4MRL_ENDPOINT", medium.endpoint)
    return medium


def test_a_suite_has_the_benchmarks_whose_names_fit(own: b4mrl.Client) -> None:
    suite = b4mrl.suite("HalfCheetah/confounding/*")
    assert len(suite) == 16
    assert {bench.info.challenge for bench in suite} == {"confounding"}
    assert [bench.name for bench in b4mrl.suite(HIDDEN)] == [HIDDEN]
    assert len(b4mrl.suite()) == len(own.benchmarks())
    assert "hidden-high" in suite._repr_html_()


def test_what_no_benchmark_fits_is_refused_with_the_nearest_name(own: b4mrl.Client) -> None:
    for pattern, nearest in (
        ("HalfCheetah/confonding/*", "HalfCheetah/confounding/*"),
        ("halfcheetah/*", "HalfCheetah/*"),
        ("*/claen/medium", "*/clean/medium"),
    ):
        wanted = f"unknown benchmark '{pattern}'; did you mean '{nearest}'? (`b4mrl list"
        with pytest.raises(errors.UnknownNameError, match=re.escape(wanted)):
            b4mrl.suite(pattern)
    with pytest.raises(errors.UnknownNameError, match="'v9'.*v0"):
        b4mrl.suite(version="v9")
    with pytest.raises(errors.UnknownNameError, match="did you mean 'HalfCheetah/clean/medium'"):
        b4mrl.benchmark("HalfCheetah/clean/medum")


@pytest.mark.parametrize("value", [None, 3, [], b"a", ["HalfCheetah/*"]])
def test_patterns_and_versions_of_suites_are_texts(endpoint: str, value: object) -> None:
    for name in ("pattern", "version"):
        if (name, value) == ("version", None):  # all versions
            continue
        with pytest.raises(errors.InvalidArgumentError, match=f"{name} is .*allowed: a text"):
            b4mrl.suite(endpoint=endpoint, **{name: value})


def test_a_suite_of_the_users_own_is_found_whatever_its_version(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        """
        version = "mine"
        environment = "HalfCheetah"

        [[challenge]]
        name = "mine"
        simulators = ["gravity"]
        """
    )
    with b4mrl.serve(workers=1, arguments=["--suites", tmp_path]) as endpoint:
        for version in (None, "mine"):
            (bench,) = b4mrl.suite("*/mine/*", version=version, endpoint=endpoint)
            assert bench.info.suite == "mine"
        versions = {bench.info.suite for bench in b4mrl.suite(endpoint=endpoint)}
        assert versions == {"v0", "mine"}
        assert {it.info.suite for it in b4mrl.suite(version="v0", endpoint=endpoint)} == {"v0"}
        with pytest.raises(errors.UnknownNameError) as caught:
            b4mrl.suite(bench.name, version="v0", endpoint=endpoint)
        assert f"did you mean {bench.name!r}" not in str(caught.value)


@pytest.mark.parametrize("name", ["B4MRL_SEED", "B4MRL_UPDATES", "B4MRL_LEDGER"])
def test_a_runners_number_that_is_none_is_named(
    own: b4mrl.Client, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    run = {"BENCHMARK": HIDDEN, "SEED": "0", "UPDATES": "9", "OUT": "folder"}
    for each, value in run.items():
        monkeypatch.setenv(f"B4MRL_{each}", value)
    monkeypatch.setenv(name, "1e3")
    with pytest.raises(errors.InvalidArgumentError, match=f"^{name} is '1e3', allowed: a whole"):
        b4mrl.benchmark()


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("HalfCheetah/medum", "HalfCheetah/medium-v0"),
        ("halfcheetah/MEDIUM", "HalfCheetah/medium-v0"),
        ("HalfCheetah/medium-v1", "HalfCheetah/medium-v0"),
        ("Halfcheetha/medium", "HalfCheetah/medium-v0"),
        ("Hopper/medium-reply", "Hopper/medium-replay-v0"),
        ("HalfCheetah/expert", None),  # resembles medium-v0 by the folder alone
        ("HalfCheetah/", None),
        ("xyzzy", None),
        ("", None),
    ],
)
def test_a_name_is_compared_by_what_follows_a_common_folder(name: str, nearest: str | None) -> None:
    known = ["HalfCheetah/medium-v0", "HalfCheetah/mr", "Hopper/medium-replay-v0"]
    assert errors.nearest_name(name, known) == nearest


def test_a_benchmark_that_is_not_defined_for_an_algorithm_takes_no_result_of_it(
    own: b4mrl.Client, tmp_path: Path
) -> None:
    everything = {bench.name: bench for bench in b4mrl.suite()}
    of_sac = everything["HalfCheetah/simulators/gravity"]
    given = {"algorithm": "mine", "seed": 0, "updates": 1, "folder": tmp_path, "returns": [1.0]}
    with pytest.raises(
        errors.InvalidArgumentError, match="'mine', allowed in .*gravity: sac alone"
    ):
        of_sac.record(**given)
    excepted = replace(of_sac.info, algorithms=(), exceptions=("mine",))
    with pytest.raises(errors.InvalidArgumentError, match="'mine', allowed in .*: all but mine"):
        b4mrl.Benchmark(own, excepted).record(**given)
    assert list(tmp_path.iterdir()) == []
    mine = {bench.name for bench in b4mrl.suite(algorithm="mine")}
    of_others = {name for name, bench in everything.items() if bench.info.algorithms}
    assert mine == everything.keys() - of_others and of_others
    assert of_sac.name in {bench.name for bench in b4mrl.suite(algorithm="sac")}
    with pytest.raises(errors.UnknownNameError, match="'HalfCheetah/simulators/.*'mine'"):
        b4mrl.suite("HalfCheetah/simulators/*", algorithm="mine")


@pytest.mark.parametrize("name", ["", "my_method", "my method", "a/b", "m\u00e9thode", "x" * 41, 3])
def test_a_name_that_no_algorithm_can_have_is_refused_before_a_training(
    own: b4mrl.Client, name: object
) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="^algorithm is .*, allowed: "):
        b4mrl.suite(algorithm=name)
    calls: list[np.ndarray] = []
    with pytest.raises(errors.InvalidArgumentError, match="^algorithm is .*, allowed: "):
        own.benchmark(HIDDEN).log(0, 1, calls.append, algorithm=name)
    assert calls == []  # no evaluation before it


def test_a_curve_is_refused_to_an_algorithm_whose_result_would_be(own: b4mrl.Client) -> None:
    rule = (
        "^algorithm is '{}', allowed: 1 to 40 letters .*, but none of B4MRL's own algorithms .*, in "
        "capital or small letters, whose"
    )
    for name in ("sac", "SAC", "Td3-Bc"):
        with pytest.raises(errors.InvalidArgumentError, match=rule.format(name)):
            own.benchmark(HIDDEN).log(0, 1, still, algorithm=name)
    with pytest.raises(errors.InvalidArgumentError, match="'mine', allowed in .*: sac alone"):
        own.benchmark("HalfCheetah/simulators/gravity").log(0, 1, still, algorithm="mine")
    assert own.benchmark(HIDDEN).log(0, 1, still, episodes=1, algorithm="mine").given_up == 0


def test_a_suite_for_an_algorithm_is_what_the_runner_trains(
    own: b4mrl.Client, tmp_path: Path
) -> None:
    program = Path(find_server()[0]).with_name("b4mrl-benchmark")
    command = [program, "run", "--dry-run", "--json", "--budget", "smoke", "--seeds", "0"]
    command += ["--learner", "true", "--name", "mine", "--out", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    planned = {name for run in json.loads(done.stdout) for name in run["benchmarks"]}
    unmakeable = {"HalfCheetah/action-delay/gravity+action-delay"}  # the runner says so
    suite = {bench.name for bench in b4mrl.suite(algorithm="mine")}
    assert planned - unmakeable == suite - unmakeable


def test_a_missing_dataset_is_made_in_the_data_folder_of_the_daemon(tmp_path: Path) -> None:
    with b4mrl.serve(data=tmp_path) as endpoint:
        bench = b4mrl.benchmark("HalfCheetah/clean/random", endpoint=endpoint, rows=500)
        assert not any(tmp_path.iterdir())
        assert bench.dataset.rows == 500
        assert (tmp_path / "HalfCheetah" / "random-v0.h5").exists()
        unmade = b4mrl.benchmark("Highway/clean/random", endpoint=endpoint, rows=2**40)
        with pytest.raises(errors.InvalidArgumentError, match="dataset make Highway/random"):
            unmade.dataset
        # No agent has reached the medium level there, so no recipe makes the dataset.
        (unmakeable,) = b4mrl.suite("*/gravity+action-delay", algorithm="mine", endpoint=endpoint)
        with pytest.raises(errors.FailedPreconditionError, match="^`.*HalfCheetah/action-delay.*3"):
            unmakeable.dataset


def test_no_client_and_no_daemon_are_needed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("B4MRL_ENDPOINT", raising=False)
    monkeypatch.setenv("B4MRL_DATA", str(tmp_path))
    serve = sys.modules["b4mrl.serve"]  # the name b4mrl.serve is the function's
    monkeypatch.setattr(serve, "_shared_daemon", None)
    bench = b4mrl.benchmark("HalfCheetah/clean/random", rows=500)
    assert bench.dataset.rows == 500
    assert (tmp_path / "HalfCheetah" / "random-v0.h5").exists()
    serve._shared_daemon.stop()


def test_a_program_that_nobody_started_is_told_how(own: b4mrl.Client) -> None:
    with pytest.raises(errors.FailedPreconditionError, match="b4mrl benchmark run --learner"):
        b4mrl.benchmark()


def run_learner(
    medium: b4mrl.Client, out: Path, *command: str | Path, updates: int = 1
) -> LedgerCounts:
    """Runs a learner's program as the runner does; what the program used."""
    ledger = medium.ledger()
    asked = {
        "B4MRL_ENDPOINT": medium.endpoint,
        "B4MRL_BENCHMARK": HIDDEN,
        "B4MRL_SEED": "7",
        "B4MRL_UPDATES": str(updates),
        "B4MRL_OUT": str(out),
        "B4MRL_LEDGER": str(ledger.number),
        "B4MRL_SUITES": "",
    }
    done = subprocess.run(
        [sys.executable, *command],
        env=dict(os.environ) | asked,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    return ledger.counts()


def test_a_program_that_the_runner_starts_knows_what_it_asks_for(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    program = """
import json
import b4mrl

bench = b4mrl.benchmark()
bench.dataset.sample(40)
(bench.out / "asked.json").write_text(json.dumps([bench.name, bench.seed, bench.updates]))
"""
    used = run_learner(medium, tmp_path, "-c", program, updates=50)
    assert json.loads((tmp_path / "asked.json").read_text()) == [HIDDEN, 7, 50]
    assert used.dataset_rows == 40


def test_the_learner_in_numpy_leaves_an_agent_that_clones(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    used = run_learner(medium, tmp_path, EXAMPLES / "own_learner_numpy.py")
    assert (used.dataset_rows, used.steps) == (2_000, 0)
    bench = medium.benchmark(HIDDEN)
    agent = b4mrl.load_agent(tmp_path / "agent.h5")
    rows = bench.dataset.load()
    error = np.abs(agent(rows["observations"]) - rows["actions"]).mean()
    # The best constant action errs by the mean deviation of the data's actions.
    assert error < 0.7 * np.abs(rows["actions"] - np.median(rows["actions"], axis=0)).mean()
    assert agent(np.eye(17)[9]).tolist() == agent(np.zeros(17)).tolist()  # the hidden dimension


def test_the_learner_in_numpy_takes_a_mask_that_is_a_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(0)
    rows = {"observations": rng.normal(size=(50, 25)), "actions": rng.uniform(-1, 1, (50, 2))}
    mask = np.arange(25).reshape(5, 5) != 3
    dataset = SimpleNamespace(load=lambda: rows)
    bench = SimpleNamespace(dataset=dataset, mask=mask, out=tmp_path, environment="Highway", seed=0)
    monkeypatch.setattr(b4mrl, "benchmark", lambda: bench)
    runpy.run_path(str(EXAMPLES / "own_learner_numpy.py"))
    agent = b4mrl.load_agent(tmp_path / "agent.h5")
    tables = rows["observations"].reshape(50, 5, 5).copy()
    actions = agent(tables)
    assert actions.shape == (50, 2)
    tables[:, 0, 3] += 1  # the hidden dimension
    np.testing.assert_array_equal(agent(tables), actions)


def test_the_runner_and_the_client_write_the_same_file_for_a_users_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("B4MRL_ENDPOINT", raising=False)
    runner = Path(find_server()[0]).with_name("b4mrl-benchmark")
    learner = f"{sys.executable} {EXAMPLES / 'own_learner_numpy.py'}"
    words = ["--learner", learner, "--name", "ridge", "--budget", "smoke", "--out", tmp_path]
    done = subprocess.run(
        [runner, "run", HIDDEN, *words], capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    with b4mrl.serve(data=tmp_path / "data") as endpoint, b4mrl.connect(endpoint) as client:
        bench = client.benchmark(HIDDEN)
        (result,) = bench.results(tmp_path)
        (agent,) = tmp_path.glob("runs/*/agent.h5")
        given = {"algorithm": "ridge", "seed": 0, "updates": 1, "episodes": 1}
        path = bench.record(agent, folder=tmp_path / "mine", **given)
    assert path.name == result.path.name  # the id is in it
    theirs, ours = result.entries, json.loads(path.read_text())
    # The runner alone has started the learner, and knows its command.
    assert ours.keys() == theirs.keys() - {"learner_sha256"}
    # What both were told, or have read from the same files.
    measured = {"score", "return", "returns", "scorings", "last_fifth", "curve", "seconds"}
    of_the_runner = {"budget", "planned_updates", "commit", "ledger"}
    for name in ours.keys() - measured - of_the_runner:
        assert ours[name] == theirs[name], name
    assert theirs["ledger"]["dataset_rows"] == 10_000  # which the learner's own process used
    counted = "evaluation_episodes"
    assert ours["ledger"][counted] == theirs["ledger"][counted] == 1


def test_the_loop_of_the_readme_fills_a_row_for_each_benchmark(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = tmp_path / "data"
    for level in ("random", "medium", "medium-replay", "medium-expert"):
        run_dataset(data, "make", f"HalfCheetah/{level}", "--rows", "2000")
    monkeypatch.chdir(tmp_path)
    with b4mrl.serve(data=data) as endpoint:
        monkeypatch.setenv("B4MRL_ENDPOINT", endpoint)
        exec(program_with("b4mrl.suite(", "README.md"), {})
        suite = b4mrl.suite("HalfCheetah/confounding/hidden-*")
        rows = [bench.results("runs/benchmark") for bench in suite]
    assert [len(found) for found in rows] == [1] * 8
    assert {found[0].algorithm for found in rows} == {"ridge"}
    assert len({found[0].path for found in rows}) == 8
    assert all(found[0].source == "user" for found in rows)


def test_a_benchmark_goes_on_counting_without_its_ledger(
    own: b4mrl.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A daemon that was started anew has no ledgers of before."""
    bench = own.benchmark(HIDDEN)
    bench.log(0, 1, still, episodes=3)

    def lost() -> None:
        raise errors.UnknownNameError("unknown ledger")

    data = bench.dataset
    assert data is not None
    data.sample(256)
    monkeypatch.setattr(bench._usage.learning, "counts", lost)
    with pytest.warns(RuntimeWarning, match="lost the ledger"):
        path = bench.record(returns=[1.0], algorithm="mine", seed=0, updates=2, folder=tmp_path)
    assert json.loads(path.read_text())["ledger"]["evaluation_episodes"] == 3 + 1
    # What is opened from now on counts in another ledger, and a training that lost its counts is
    # no cell that was executed once more.
    assert bench.dataset is not data
    bench.dataset.sample(256)
    monkeypatch.setattr(bench._usage.learning, "counts", lost)
    with pytest.warns(RuntimeWarning, match="lost the ledger"):
        path = bench.record(returns=[2.0], algorithm="mine", seed=0, updates=2, folder=tmp_path)
    assert json.loads(path.read_text())["seconds"] < 10
    bench.dataset.sample(256)
    path = bench.record(returns=[3.0], algorithm="mine", seed=1, updates=2, folder=tmp_path)
    assert json.loads(path.read_text())["ledger"]["dataset_rows"] == 256


def test_each_forked_process_counts_its_own_use(own: b4mrl.Client, tmp_path: Path) -> None:
    bench = own.benchmark(HIDDEN)
    bench.dataset.sample(256)

    def train(seed: int) -> None:
        for _ in range(seed):
            bench.dataset.sample(256)
        bench.record(returns=[1.0], algorithm="mine", seed=seed, updates=2, folder=tmp_path)

    fork = multiprocessing.get_context("fork")
    children = [fork.Process(target=train, args=(seed,)) for seed in (1, 2)]
    for child in children:
        child.start()
    for child in children:
        child.join(60)
        assert child.exitcode == 0
    train(3)
    used = {
        entries["seed"]: entries["ledger"]["dataset_rows"]
        for entries in (json.loads(path.read_text()) for path in tmp_path.glob("*.json"))
    }
    assert used == {1: 256, 2: 512, 3: 256 + 3 * 256}
