"""The files of results: their names, their ids and what is refused of them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import b4mrl
import pytest
from b4mrl import errors
from b4mrl.benchmarks import result_file
from b4mrl.benchmarks.seeds import hash_name
from b4mrl.serve import find_server

from test_benchmark import HIDDEN

CLEAN = "HalfCheetah/clean/medium"


def infos(client: b4mrl.Client) -> dict[str, b4mrl.descriptions.BenchmarkInfo]:
    return {info.name: info for info in client.benchmarks()}


def test_the_ids_are_those_that_the_runner_gives(client: b4mrl.Client) -> None:
    """Constants that the runner's own test has, too (tests/benchmarks/plan/plan_test.cc)."""
    info = infos(client)["HalfCheetah/confounding/hidden-high+medium-expert"]
    assert result_file.identities(info, "mine", 2_000_000, 3) == (
        "3c479c8b912bc39c",
        "c0288e4249f97ab8",
    )


def test_the_names_are_those_that_the_runner_gives(client: b4mrl.Client) -> None:
    known = infos(client)
    for benchmark, name in (
        (HIDDEN, "HalfCheetah-mine-gravity-medium+hidden-high-s3"),
        (CLEAN, "HalfCheetah-mine-true-medium-s3"),
        ("HalfCheetah/simulators/friction", "HalfCheetah-mine-friction-s3"),
        (
            "HalfCheetah/action-delay/gravity+action-delay",
            "HalfCheetah-mine-gravity-action-delay-in-action-delay-s3",
        ),
    ):
        assert result_file.run_name(known[benchmark], "mine", 3) == name
    foreign = replace(known[CLEAN], dataset="d4rl/halfcheetah-medium-v2")
    # No file has such a name, so the name ends with its own hash.
    name = "HalfCheetah-mine-true-d4rl/halfcheetah-medium-v2-s3"
    hashed = f"{name.replace('/', '_')}-{hash_name(name):016x}"
    assert result_file.run_name(foreign, "mine", 3) == hashed
    assert hash_name("foobar") == 0x85944171F73967E8  # published with FNV-1a


def test_a_folder_that_is_not_there_is_told_and_has_no_result(
    client: b4mrl.Client, tmp_path: Path, recwarn: pytest.WarningsRecorder
) -> None:
    bench = client.benchmark(CLEAN)
    assert bench.results(tmp_path) == []
    assert not recwarn
    with pytest.warns(RuntimeWarning, match=f"there is no folder {tmp_path}/missing") as caught:
        assert bench.results(tmp_path / "missing") == []
    assert caught[0].filename == __file__


def test_the_own_algorithms_are_those_of_the_program() -> None:
    tools = Path(find_server()[0]).with_name("b4mrl-tools")
    done = subprocess.run([tools, "list", "algorithms", "--json"], capture_output=True, check=True)
    assert {each["name"] for each in json.loads(done.stdout)} == set(result_file.ALGORITHMS)


@pytest.mark.parametrize("names", [None, 5, f"before {CLEAN} after", {CLEAN: 1}, [[CLEAN]]])
def test_a_file_that_names_no_benchmarks_is_no_result(tmp_path: Path, names: object) -> None:
    (tmp_path / "other.json").write_text(json.dumps({"benchmarks": names}))
    assert result_file.find(tmp_path, CLEAN) == []


IN_ANOTHER_ENCODING = """
import pathlib, sys, types
from b4mrl.benchmarks import result_file

folder = pathlib.Path(sys.argv[1])
(found,) = result_file.find(folder, "b")
names = dict(environment="E", simulator="", dataset="", corruption="", world="")
entries = found.entries | {"id": "0", "algorithm": "other"}
print(ascii(found.entries["note"]))
result_file.write(folder, types.SimpleNamespace(**names), entries)
assert len(result_file.find(folder, "b")) == 2
"""


def test_results_are_utf_8_whatever_the_machines_encoding_is(tmp_path: Path) -> None:
    entries = {name: None for name in ("score", "settled")}
    entries |= {"algorithm": "mine", "source": "user", "finished": True, "note": "ü"}
    entries |= {"benchmarks": ["b"], "seed": 0, "updates": 1, "return": 1.0}
    text = json.dumps(entries, ensure_ascii=False)
    (tmp_path / "result.json").write_text(text, encoding="utf-8")
    variables = os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    command = [sys.executable, "-c", IN_ANOTHER_ENCODING, tmp_path]
    done = subprocess.run(command, env=variables, capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, r"'\xfc'"), done.stderr
    (other,) = tmp_path.glob("E-other-*.json")
    assert "ü" in other.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("entry", "value", "allowed"),
    [
        ("algorithm", None, "a text"),
        ("seed", "0", "a whole number"),
        ("updates", True, "a whole number"),
        ("finished", None, "true or false"),
        ("score", "high", "a number, a whole number, null"),
        ("return", None, "a number"),
        ("settled", 1, "true or false, null"),
        ("source", ["own"], "a text"),
    ],
)
def test_a_result_with_an_entry_of_another_type_is_named(
    tmp_path: Path, entry: str, value: object, allowed: str
) -> None:
    whole = {
        "benchmarks": [CLEAN],
        "algorithm": "mine",
        "seed": 0,
        "updates": 5,
        "finished": True,
        "score": None,
        "return": 1.5,
        "settled": None,
        "source": "user",
    }
    path = tmp_path / "result.json"
    path.write_text(json.dumps(whole))
    assert result_file.find(tmp_path, CLEAN)[0].mean_return == 1.5
    path.write_text(json.dumps(whole | {entry: value}))
    with pytest.raises(errors.DataLossError, match=f"result.json.* {entry} is .*: {allowed}"):
        result_file.find(tmp_path, CLEAN)


def test_the_drift_of_a_curve_is_measured_over_its_last_two_fifths() -> None:
    curve = [(10 * i, 0, 0.0, 0.0, float(score)) for i, score in enumerate((9, 1, 2, 3, 4, 8))]
    drift = result_file._drift(curve)
    assert drift == {"last_fifth": 8.0, "fifth_before": 4.0, "settled": False}
    assert result_file._drift([*curve[:-1], (50, 0, 0.0, 0.0, 5.5)])["settled"]
    without_score = [(each[0], 0, 7.0, 0.0, None) for each in curve]
    assert result_file._drift(without_score)["last_fifth"] == 7.0
    # Returns have no scale: 1.5 is much for a task whose best return is 9.
    rising = [
        (10 * i, 0, value, 0.0, None) for i, value in enumerate((1.75, 2.0, 4.0, 6.0, 7.75, 9.0))
    ]
    assert not result_file._drift(rising)["settled"]
    assert result_file._drift([*rising[:-1], (50, 0, 7.875, 0.0, None)])["settled"]


@pytest.mark.parametrize("value", [3, "abc", [("a", 1)], {3: 4}, {"x": float("nan")}, {"x": 1j}])
def test_hyperparameters_that_no_result_can_hold_are_refused(value: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="hyperparameters .*allowed"):
        result_file.plain_hyperparameters(value)
    assert result_file.plain_hyperparameters(None) == {}
