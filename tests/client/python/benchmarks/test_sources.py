"""The sources of a benchmark: datasets that are there or missing, what they hide, and seeds."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import b4mrl
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks import making
from b4mrl.benchmarks.benchmark import Benchmark
from b4mrl.serve import find_server

from made_dataset import run_dataset
from test_benchmark import HIDDEN, NOISY, still

RANDOM = "HalfCheetah/clean/random"
PARTIAL = "HalfCheetah/partial-observability-dataset/gravity+partial-high"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The address of a daemon that has HalfCheetah/random, of 500 rows."""
    data = tmp_path_factory.mktemp("small")
    run_dataset(data, "make", "HalfCheetah/random", "--rows", "500")
    with b4mrl.serve(data=data) as endpoint:
        yield endpoint


@pytest.fixture
def empty(tmp_path: Path) -> Iterator[b4mrl.Client]:
    """A client of a daemon without datasets."""
    with b4mrl.serve(data=tmp_path, workers=1) as endpoint, b4mrl.connect(endpoint) as client:
        yield client


@pytest.mark.parametrize(
    ("rows", "warning"),
    [
        (700, "and is used as it is: rows=700 .*HalfCheetah/random --replace --rows 700`"),
        (
            0,
            "and was made with --rows, .*rows=0 .*`b4mrl dataset make HalfCheetah/random --replace`",
        ),
    ],
)
def test_a_dataset_of_other_rows_than_asked_for_is_used_with_a_warning(
    small: str, rows: int, warning: str
) -> None:
    bench = b4mrl.benchmark(RANDOM, endpoint=small, rows=rows)
    with pytest.warns(RuntimeWarning, match=f"HalfCheetah/random has 500 rows {warning}") as caught:
        assert bench.dataset.rows == 500
    assert [Path(each.filename).name for each in caught] == ["test_sources.py"]


def test_the_warning_is_at_the_users_line_also_where_a_policy_is_evaluated(small: str) -> None:
    bench = b4mrl.benchmark(RANDOM, endpoint=small, rows=700)
    with pytest.warns(RuntimeWarning, match="is used as it is") as caught:
        bench.evaluate(lambda rows: np.zeros((len(rows), 6)), episodes=1)
    assert [Path(each.filename).name for each in caught] == ["test_sources.py"]


@pytest.mark.filterwarnings("error")
def test_a_dataset_that_is_as_asked_for_is_used_in_silence(small: str, tmp_path: Path) -> None:
    assert b4mrl.benchmark(RANDOM, endpoint=small, rows=500).dataset.rows == 500
    with b4mrl.connect(small) as client:
        bench = client.benchmark(RANDOM)  # asks for none
        assert bench.dataset.rows == 500
        # The runner's datasets have as many rows as its budget says.
        asked = Benchmark(client, bench.info, make_rows=0, seed=1, updates=1, out=tmp_path)
        assert asked.dataset.rows == 500


@pytest.mark.filterwarnings("error")
def test_a_dataset_by_an_agent_of_the_users_own_is_no_other_than_published(small: str) -> None:
    with b4mrl.connect(small) as client:
        found = client.dataset("HalfCheetah/random").in_force
    for command in ("HalfCheetah/mine --agent mine.h5 --rows 500", "HalfCheetah/random-v0"):
        provenance = replace(found.provenance, command=f"b4mrl dataset make {command}")
        making.warn_of_other_rows("HalfCheetah/x", replace(found, provenance=provenance), 0)


@pytest.mark.parametrize("lacks", ["b4mrl-serve", "b4mrl"])
def test_a_dataset_that_cannot_be_made_from_here_is_named_and_not_the_program(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lacks: str
) -> None:
    """As with a daemon on another machine, where only the Python package is installed."""

    def find() -> list[str]:
        if lacks == "b4mrl":
            return [str(tmp_path / "b4mrl-serve")]
        raise errors.UnavailableError("the program b4mrl-serve is not found")

    monkeypatch.setattr(making, "find_server", find)
    missing = re.escape(f"the daemon at {client.endpoint} lacks the dataset 'HalfCheetah/random'")
    advice = "run `b4mrl dataset make HalfCheetah/random --rows 500` on its machine"
    bench = b4mrl.benchmark(RANDOM, endpoint=client.endpoint, rows=500)
    with pytest.raises(
        errors.UnknownNameError, match=f"^{missing}; {advice}, as .*b4mrl"
    ) as caught:
        bench.dataset
    assert isinstance(caught.value.__cause__, (errors.UnavailableError, OSError))


@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        (HIDDEN, [9]),
        (NOISY, []),
        ("HalfCheetah/clean/medium", []),
        ("HalfCheetah/action-delay/gravity+action-delay", []),
        ("Highway/confounding/hidden-low+medium", [3, 4, 8, 9, 13, 14, 18, 19, 23, 24]),
    ],
)
def test_a_policy_is_evaluated_without_a_dataset_whose_recipe_hides_nothing(
    empty: b4mrl.Client, name: str, hidden: list[int]
) -> None:
    bench = b4mrl.benchmark(name, endpoint=empty.endpoint)
    np.testing.assert_array_equal(np.flatnonzero(~bench.mask), hidden)
    if bench.environment == "HalfCheetah":
        observe = "served" if name == NOISY else "trained"
        assert bench.evaluate(still, episodes=1, observe=observe).lengths.tolist() == [1000]
    assert empty.datasets() == []


def test_what_a_dataset_may_hide_is_not_guessed(empty: b4mrl.Client, tmp_path: Path) -> None:
    with pytest.raises(errors.UnknownNameError, match="HalfCheetah/partial-high"):
        empty.benchmark(PARTIAL).evaluate(still)
    bench = b4mrl.benchmark(PARTIAL, endpoint=empty.endpoint, rows=500)
    assert np.flatnonzero(~bench.mask).tolist() == [9]
    assert bench.dataset.rows == 500  # made for it


def test_the_datasets_whose_recipes_hide_nothing_are_known() -> None:
    tools = Path(find_server()[0]).with_name("b4mrl-tools")
    done = subprocess.run([tools, "list", "datasets", "--json"], capture_output=True, check=True)
    names = {each["name"] for each in json.loads(done.stdout)}
    complete = {name for name in names if making.records_everything(name)}
    assert names - complete == {
        f"HalfCheetah/partial-{kind}-v0" for kind in ("low", "low-history", "high", "high-history")
    }
    assert len(making._COMPLETE) == len(complete)


@pytest.mark.parametrize("name", [HIDDEN, NOISY])
def test_the_simulator_has_the_flaws_of_the_dataset_in_the_same_words(
    medium: b4mrl.Client, name: str
) -> None:
    bench = medium.benchmark(name)
    assert bench._seen_through == bench.dataset.in_force.corruptions != ()


def test_what_the_runner_starts_follows_its_seed_unless_it_names_another(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    info = medium.benchmark("HalfCheetah/clean/medium").info
    bench = Benchmark(medium, info, seed=7, updates=1, out=tmp_path)
    data, other = bench.dataset, medium.dataset("HalfCheetah/medium")
    for copy in (data, pickle.loads(pickle.dumps(data))):
        for given, seed in (({}, 7), ({"seed": 3}, 3), ({"seed": 0}, 0)):
            wanted = other.sample(8, seed=seed, batch=0)["observations"]
            sampled = copy.sample(8, batch=0, **given)["observations"]
            streamed = next(copy.stream(8, **given))["observations"]
            np.testing.assert_array_equal(sampled, wanted)
            np.testing.assert_array_equal(streamed, wanted)
    for given, seed in (({}, 7), ({"seed": 3}, 3)):
        with bench.make_simulator(2, **given) as vec:
            assert vec.session.in_force.seed == seed
    np.testing.assert_array_equal(
        other.sample(8, batch=0)["actions"], other.sample(8, seed=0, batch=0)["actions"]
    )


def test_queries_of_a_run_have_the_noise_of_its_seed(client: b4mrl.Client, tmp_path: Path) -> None:
    part = np.zeros((3, 17)), np.zeros((3, 6))
    info = client.benchmark("HalfCheetah/simulators/obs-noise-high").info
    bench = Benchmark(client, info, seed=7, updates=1, out=tmp_path)
    for given, seed in (({}, 7), ({"seed": 3}, 3), ({"seed": 0}, 0)):
        wanted = client.query("HalfCheetah", *part, "obs-noise-high", seed=seed, draw=0)[0]
        np.testing.assert_array_equal(bench.query(*part, draw=0, **given)[0], wanted)


def test_simulators_outside_the_runner_have_a_seed_of_their_own(client: b4mrl.Client) -> None:
    bench = client.benchmark("HalfCheetah/simulators/gravity")
    with bench.make_simulator() as one, bench.make_simulator() as two:
        assert one.session.in_force.seed != two.session.in_force.seed


def test_a_dataset_that_was_closed_is_opened_again(small: str) -> None:
    bench = b4mrl.benchmark(RANDOM, endpoint=small, rows=500)
    for _ in range(2):
        with bench.dataset as data:
            assert len(data.sample(3)["rewards"]) == 3
    assert data.is_closed and not bench.dataset.is_closed


def test_what_the_benchmark_has_of_its_own_is_no_option_of_its_simulator(small: str) -> None:
    bench = b4mrl.benchmark(RANDOM, endpoint=small)
    for options in ({"simulator": "gravity"}, {"ledger": 7}):
        with pytest.raises(errors.InvalidArgumentError, match=f"^{next(iter(options))} is given"):
            bench.make_simulator(1, **options)


def test_a_mask_takes_no_ledger(small: str) -> None:
    bench = b4mrl.benchmark(RANDOM, endpoint=small, rows=500)
    assert bench.mask.all()
    assert bench._usage._ledger is None


class Command:
    """Stands for `b4mrl dataset make`; `done` is what another program has done meanwhile."""

    def __init__(self, codes: list[int], is_there: list[bool]) -> None:
        self.codes, self.is_there = codes, is_there

    def open_it(self) -> str:
        if not self.is_there.pop(0):
            raise errors.UnknownNameError("unknown dataset")
        return "the dataset"

    def run(self, *_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(returncode=self.codes.pop(0))


@pytest.fixture
def made_by(monkeypatch: pytest.MonkeyPatch) -> Callable[[list[int], list[bool]], object]:
    def make(codes: list[int], is_there: list[bool]) -> object:
        command = Command(codes, is_there)
        monkeypatch.setattr(making.subprocess, "run", command.run)
        monkeypatch.setattr(making, "_POLL_S", 0.0)
        opened = making.open_or_make(command.open_it, "HalfCheetah/random", "ipc:///nobody", 0)
        assert not command.codes and not command.is_there
        return opened

    return make


def test_a_dataset_that_another_program_makes_is_waited_for(made_by: Callable[..., object]) -> None:
    assert made_by([6, 6], [False, False, True]) == "the dataset"
    assert made_by([3], [False, True]) == "the dataset"  # it was quicker


def test_a_dataset_that_nobody_makes_is_an_error(made_by: Callable[..., object]) -> None:
    with pytest.raises(errors.FailedPreconditionError, match="cannot make the dataset"):
        made_by([3], [False, False])
    with pytest.raises(errors.DataLossError, match="failed"):
        made_by([1], [False, False])


def test_rows_that_are_not_those_published_are_used_with_a_warning(
    made_by: Callable[..., object],
) -> None:
    with pytest.warns(RuntimeWarning, match="other rows than the published ones"):
        assert made_by([1], [False, True]) == "the dataset"
