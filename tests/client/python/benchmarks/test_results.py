"""Results of users' algorithms: the files, their names and what they say."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks import making, result_file, usage
from b4mrl.dataset import Dataset

from conftest import BENCHMARK_ROWS as ROWS
from test_benchmark import HIDDEN, NOISY, still
from test_result_file import CLEAN


def entries_of(path: Path) -> dict:
    return json.loads(path.read_text())


def test_a_result_says_what_was_trained_and_what_it_reached(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(HIDDEN)
    rows = bench.dataset.load()
    with bench.make_simulator(num_envs=2) as vec:
        vec.reset(seed=0)
        for _ in range(5):
            vec.step(np.zeros((2, 6)))
    bench.query(rows["observations"][:7], rows["actions"][:7])
    bench.evaluate(still, episodes=3)  # of the learner's own, which no result counts
    bench.log(3, 100, still)
    bench.log(3, 180, still, episodes=2)
    path = bench.record(
        still, algorithm="mine", seed=3, updates=200, folder=tmp_path, hyperparameters={"rate": 0.1}
    )
    entries = entries_of(path)
    run, cell = result_file.identities(bench.info, "mine", ROWS, 3)
    assert path.name == f"HalfCheetah-mine-gravity-medium+hidden-high-s3-{run}.json"
    assert (entries["id"], entries["cell"], entries["benchmarks"]) == (run, cell, [HIDDEN])
    assert entries["ledger"] == {
        "simulator_steps": 10,
        "query_rows": 7,
        "dataset_rows": ROWS,
        "evaluation_episodes": 10 + 2 + 10,  # without the ten that observe in full
    }
    scores = bench.evaluate(still)
    assert entries["returns"] == scores.returns.tolist() and len(entries["returns"]) == 10
    assert (entries["score"], entries["return"]) == (scores.score, scores.mean_return)
    assert entries["scorings"].keys() == {"full"}
    assert entries["scorings"]["full"]["returns"] == entries["returns"]  # it does not look
    assert entries["curve_columns"] == ["updates", "steps", "return", "std", "score"]
    assert [point[:2] for point in entries["curve"]] == [[100, 10], [180, 10], [200, 10]]
    assert entries["curve"][-1][2:] == [scores.mean_return, scores.std_return, scores.score]
    assert entries["last_fifth"] == pytest.approx(
        (entries["curve"][1][4] + entries["curve"][2][4]) / 2, rel=1e-12
    )
    assert (entries["fifth_before"], entries["settled"]) == (None, None)
    wanted = {
        "suite": "v0",
        "algorithm": "mine",
        "environment": "HalfCheetah",
        "simulator": "gravity",
        "corruption": "hidden-high",
        "corruption_seed": 0,
        "transitions": "stored",
        "history": 1,
        "world": "",
        "seed": 3,
        "precision": None,
        "recipe": None,
        "hyperparameters": {"rate": 0.1},
        "budget": None,
        "planned_updates": 200,
        "updates": 200,
        "finished": True,
        "source": "user",
        "selection": "last",
        "environment_steps": 10,
        "version": b4mrl.__version__,
        "commit": None,
        "sessions": [],
    }
    assert {name: entries[name] for name in wanted} == wanted
    info = bench.dataset.in_force.info
    assert entries["dataset"] == {
        "name": "HalfCheetah/medium-v0",
        "rows": ROWS,
        "sha256": info.sha256,
        "columns_sha256": info.columns_sha256,
    }
    assert entries["seconds"] > 0


def test_a_result_has_one_line_for_each_entry_and_each_point(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(CLEAN)
    bench.log(0, 1, still, episodes=1)
    path = bench.record(
        returns=[1.0], algorithm="mine", seed=0, updates=2, folder=tmp_path / "made"
    )
    lines = path.read_text().splitlines()
    entries = entries_of(path)
    assert lines[0] == "{" and lines[-1] == "}"
    assert len(lines) == 2 + len(entries) + 2 + 1  # two points, and the bracket behind them
    assert lines[1] == f' "id": "{entries["id"]}",'
    assert lines[-4].startswith("  [1,0,") and lines[-4].endswith("],")
    assert lines[-3].startswith("  [2,0,1.0,0.0,") and lines[-2] == " ]"


def test_a_result_of_given_returns_says_that_nobody_else_has_scored_it(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(HIDDEN)
    path = bench.record(returns=[4000, 6000], algorithm="mine", seed=0, updates=10, folder=tmp_path)
    entries = entries_of(path)
    assert entries["source"] == "self-scored" and entries["scorings"] == {}
    assert (entries["return"], entries["returns"]) == (5000, [4000, 6000])
    assert entries["score"] == pytest.approx(42.5, abs=0.5)  # D4RL's expert returns 12,135
    assert entries["ledger"]["evaluation_episodes"] == 2
    for returns in ([], [np.nan], 3.0):
        with pytest.raises(errors.InvalidArgumentError, match="returns are"):
            bench.record(returns=returns, algorithm="mine", seed=0, updates=10, folder=tmp_path)
    for both in ({"policy": still, "returns": [1.0]}, {}):
        with pytest.raises(errors.InvalidArgumentError, match="policy and returns are both"):
            bench.record(algorithm="mine", seed=0, updates=1, folder=tmp_path, **both)


def test_a_recorded_agent_is_named_by_its_hash_and_scored_through_the_noise(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(NOISY)
    agent = tmp_path / "agent.h5"
    rng = np.random.default_rng(0)
    b4mrl.save_agent(agent, [(rng.normal(size=(6, 17)), np.zeros(6))])
    entries = entries_of(
        bench.record(agent, algorithm="mine", seed=0, updates=1, folder=tmp_path, episodes=2)
    )
    assert entries["agent_sha256"] == hashlib.sha256(agent.read_bytes()).hexdigest()
    assert entries["scorings"]["served"]["simulator"] == "obs-noise=0.05"
    assert entries["scorings"]["served"]["observe"] == "trained"
    assert entries["scorings"]["served"]["returns"] != entries["returns"]


@pytest.mark.parametrize(
    "name",
    [*result_file.ALGORITHMS, "SAC", "TD3-BC", "HyMOPO", "", "my algorithm", "a/b", "x" * 41],
)
def test_names_that_others_have_or_files_cannot_have_are_refused(
    medium: b4mrl.Client, name: str, tmp_path: Path
) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="algorithm is"):
        medium.benchmark(CLEAN).record(still, algorithm=name, seed=0, updates=1, folder=tmp_path)


def test_results_of_a_benchmark_are_found_where_the_runner_keeps_them(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(CLEAN)
    assert bench.results(tmp_path / "nowhere") == []
    (tmp_path / "plan.json").write_text("[]")
    given = {"returns": [1.0, 2.0], "updates": 5}
    bench.record(algorithm="mine", seed=1, folder=tmp_path / "results", **given)
    bench.record(algorithm="mine", seed=0, folder=tmp_path / "results", **given)
    bench.record(algorithm="mine", seed=0, folder=tmp_path / "results", **given)  # replaces it
    medium.benchmark(HIDDEN).record(algorithm="mine", seed=0, folder=tmp_path / "results", **given)
    found = bench.results(tmp_path)
    assert [(each.algorithm, each.seed, each.updates) for each in found] == [
        ("mine", 0, 5),
        ("mine", 1, 5),
    ]
    assert found[0].mean_return == 1.5 and found[0].source == "self-scored"
    assert found[0].entries["returns"] == [1.0, 2.0]
    assert "mean_return" in found._repr_html_()
    assert bench.results(tmp_path / "results")[1].path == found[1].path
    (tmp_path / "results" / "cut.json").write_text("{")
    with pytest.raises(errors.DataLossError, match="cut.json"):
        bench.results(tmp_path)
    # A result goes to where it is found.
    (tmp_path / "results" / "cut.json").unlink()
    assert bench.record(algorithm="mine", seed=1, folder=tmp_path, **given) == found[1].path
    assert len(bench.results(tmp_path)) == 2
    # A folder with results of its own is used alone: what lies in its `results` may be a copy.
    own = Path(shutil.copy(found[0].path, tmp_path))
    assert [each.path for each in bench.results(tmp_path)] == [own]
    assert bench.record(algorithm="mine", seed=0, folder=tmp_path, **given) == own


def test_json_that_is_nested_too_deeply_is_named(medium: b4mrl.Client, tmp_path: Path) -> None:
    bench = medium.benchmark(CLEAN)
    given = {"algorithm": "mine", "seed": 0, "updates": 5, "folder": tmp_path, "returns": [1.0]}
    path = bench.record(**given)
    path.write_text("[" * 100_000)
    with pytest.raises(errors.DataLossError, match=path.name):
        bench.results(tmp_path)
    assert bench.record(**given) == path  # replaces it, as any file that is no result
    assert len(bench.results(tmp_path)) == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"updates": 1e999},
        {"updates": None},
        {"curve": [[]]},
        {"curve": [1]},
        {"curve": None},
        {"ledger": None},
        {"ledger": [1]},
        {"seconds": "x"},
    ],
)
def test_a_damaged_result_of_the_same_run_is_replaced(
    medium: b4mrl.Client, tmp_path: Path, changes: dict
) -> None:
    bench = medium.benchmark(CLEAN)
    given = {"algorithm": "mine", "seed": 0, "updates": 5, "folder": tmp_path, "returns": [1.0]}
    path = bench.record(**given)
    whole = entries_of(path)
    path.write_text(json.dumps(whole | changes))
    bench.record(**given)
    assert entries_of(path)["curve"] == whole["curve"]
    assert entries_of(path)["ledger"].keys() == whole["ledger"].keys()


def test_a_curve_that_begins_again_drops_what_it_repeats(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(CLEAN)
    for updates in (10, 20, 30, 15):
        bench.log(0, updates, still, episodes=1)
    bench.log(1, 5, still, episodes=1)
    given = {"returns": [1.0], "algorithm": "mine", "folder": tmp_path}
    entries = entries_of(bench.record(seed=0, updates=40, **given))
    assert [point[0] for point in entries["curve"]] == [10, 15, 40]
    assert entries["ledger"]["evaluation_episodes"] == 3
    bench.dataset.sample(1)  # a training of its own
    curve = entries_of(bench.record(seed=0, updates=40, **given))["curve"]
    assert [point[0] for point in curve] == [40]  # a result takes its points along
    curve = entries_of(bench.record(seed=1, updates=40, **given))["curve"]
    assert [point[0] for point in curve] == [5, 40]


def test_a_result_that_cannot_be_written_loses_nothing(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(CLEAN)
    bench.log(np.int64(0), np.int64(5), still, episodes=1)
    given = {"returns": [1.0], "algorithm": "mine", "seed": np.int64(0), "updates": np.int64(9)}
    (tmp_path / "file").touch()
    with pytest.raises(OSError):
        bench.record(folder=tmp_path / "file", **given)
    with pytest.raises(errors.InvalidArgumentError, match="folder is None, allowed: a path"):
        bench.record(folder=None, **given)
    calls: list[np.ndarray] = []  # of a policy, which costs an evaluation
    with pytest.raises(OSError):
        bench.record(calls.append, folder=tmp_path / "file", algorithm="mine", seed=0, updates=9)
    assert calls == []
    with pytest.raises(errors.InvalidArgumentError, match="hyperparameters have <object"):
        bench.record(folder=tmp_path, hyperparameters={"rate": object()}, **given)
    assert not list(tmp_path.glob("*.json*")) and not list(tmp_path.glob(".*"))
    given |= {"hyperparameters": {"rate": np.float32(0.5), "sizes": np.arange(2)}}
    entries = entries_of(bench.record(folder=tmp_path, **given))
    assert [point[0] for point in entries["curve"]] == [5, 9]
    assert entries["hyperparameters"] == {"rate": 0.5, "sizes": [0, 1]}
    assert entries["ledger"]["evaluation_episodes"] == 2
    for wrong in ({"seed": -1}, {"updates": 1.5}):
        with pytest.raises(errors.InvalidArgumentError, match=next(iter(wrong))):
            bench.record(folder=tmp_path, **given | wrong)


def test_a_result_that_is_recorded_again_keeps_what_its_training_used(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    bench = medium.benchmark(CLEAN)
    given = {"algorithm": "mine", "folder": tmp_path, "seed": 0}
    bench.dataset.sample(100)
    bench.log(0, 5, lambda rows: np.zeros((len(rows), 6), np.float32), episodes=1)
    first = entries_of(bench.record(updates=10, returns=[1.0], **given))
    again = entries_of(bench.record(updates=10, returns=[3.0], **given))
    assert again["ledger"] == first["ledger"]
    assert again["ledger"]["dataset_rows"] == 100
    assert again["seconds"] == first["seconds"]
    assert again["curve"][0] == first["curve"][0]
    assert [point[2] for point in again["curve"][1:]] == [3.0]
    other = medium.benchmark(CLEAN)  # as in another program
    assert entries_of(other.record(updates=10, returns=[4.0], **given))["ledger"] == first["ledger"]
    bench.dataset.sample(7)  # a training of its own
    assert (
        entries_of(bench.record(updates=10, returns=[1.0], **given))["ledger"]["dataset_rows"] == 7
    )
    with pytest.raises(errors.FailedPreconditionError, match="a result of 10 updates"):
        bench.record(updates=9, returns=[1.0], **given)


def test_counts_begin_anew_with_each_result(medium: b4mrl.Client, tmp_path: Path) -> None:
    bench = medium.benchmark(CLEAN)
    given = {"returns": [1.0], "algorithm": "mine", "folder": tmp_path}
    for seed, rows in ((0, 100), (1, 60)):
        bench.dataset.sample(rows)
        entries = entries_of(bench.record(seed=seed, updates=1, **given))
        assert entries["ledger"]["dataset_rows"] == rows


def test_the_time_of_a_result_is_that_of_its_training(
    medium: b4mrl.Client, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 0.0
    make = making.open_or_make

    def make_slowly(*arguments: object) -> Dataset:
        nonlocal now
        now += 1000
        return make(*arguments)

    def act_slowly(observations: np.ndarray) -> np.ndarray:
        nonlocal now
        now += 100
        return still(observations)

    monkeypatch.setattr(making, "open_or_make", make_slowly)
    monkeypatch.setattr(usage, "time", SimpleNamespace(monotonic=lambda: now))
    bench = medium.benchmark(CLEAN)
    given = {"algorithm": "mine", "updates": 1, "folder": tmp_path, "episodes": 1}
    for seed in (0, 1):
        bench.dataset.sample(10)
        now += 5
        entries = entries_of(bench.record(act_slowly, seed=seed, **given))
        assert entries["seconds"] == 5
    assert now == 1000 + 2 * (5 + 100 * 1000)  # a dataset once, a policy at each of 1,000 steps
