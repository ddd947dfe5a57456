"""Benchmarks as objects: their sources, what a policy sees of them, and its score."""

from __future__ import annotations

import json
import pickle
import re
import subprocess
import typing
from pathlib import Path

import b4mrl
import h5py
import numpy as np
import pytest
from b4mrl import errors
from b4mrl.benchmarks.benchmark import Benchmark
from b4mrl.benchmarks.evaluation import Evaluation, given_returns
from b4mrl.benchmarks.seeds import role_seed
from b4mrl.dataset import Dataset
from b4mrl.descriptions import DatasetStats
from b4mrl.serve import find_server
from b4mrl.simulators import NamedArgument
from conftest import BENCHMARK_ROWS as ROWS
from test_documents import program_with

HIDDEN = "HalfCheetah/confounding/hidden-high+medium"  # the data lack dimension 9
NOISY = "HalfCheetah/confounding/obs-noise-high+medium"

RAGGED = [[1.0], [1.0, 2.0]]  # no array


class Recorder:
    """A policy that acts by a fixed linear map, and keeps what it saw."""

    def __init__(self, batches: bool = True) -> None:
        self.weights = np.random.default_rng(2).normal(scale=0.2, size=(17, 6))
        self.batches = batches
        self.seen: list[np.ndarray] = []
        self.resets = 0

    def reset(self) -> None:
        self.resets += 1

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        if not self.batches and observations.ndim > 1:
            raise TypeError("one observation, please")
        self.seen.append(observations)
        return np.tanh(observations @ self.weights)


def still(observations: np.ndarray) -> np.ndarray:
    return np.zeros((len(observations), 6))


def test_a_benchmark_has_its_two_sources(medium: b4mrl.Client) -> None:
    bench = medium.benchmark(HIDDEN)
    assert bench.paper == bench.info.paper and "td3-bc" in bench.paper
    assert bench.dataset is bench.dataset
    rows = bench.dataset.load()
    assert len(rows["rewards"]) == ROWS and not rows["observations"][:, 9].any()
    with bench.make_simulator(num_envs=3) as vec:
        assert vec.num_envs == 3
        assert [str(item) for item in vec.session.in_force.perturbations] == ["gravity=2"]
    part = rows["observations"][:5], rows["actions"][:5]
    wanted = medium.query("HalfCheetah", *part, "gravity", draw=3)
    for answer in (bench.query(*part, draw=3), bench.query_async(*part, draw=3).result()):
        np.testing.assert_array_equal(answer[0], wanted[0])


def test_queries_of_a_benchmark_have_noise_of_their_own(medium: b4mrl.Client) -> None:
    part = np.zeros((3, 17)), np.zeros((3, 6))
    medium.query("HalfCheetah", *part, "obs-noise-high")  # counts for the client alone
    bench = medium.benchmark("HalfCheetah/simulators/obs-noise-high")
    answers = [bench.query(*part)[0], bench.query_async(*part).result()[0]]
    for draw, answer in enumerate(answers):
        np.testing.assert_array_equal(bench.query(*part, draw=draw)[0], answer)
    assert np.all(answers[0] != answers[1])


@pytest.mark.filterwarnings("error")  # Python 3.14 pickles no counter of itertools any more
def test_a_pickled_benchmark_counts_on(medium: b4mrl.Client) -> None:
    part = np.zeros((3, 17)), np.zeros((3, 6))
    bench = medium.benchmark("HalfCheetah/simulators/obs-noise-high")
    bench.query(*part)
    with pytest.raises(errors.InvalidArgumentError):
        bench.query(*part, seed=-1)  # takes no draw
    copied = pickle.loads(pickle.dumps(bench))
    np.testing.assert_array_equal(copied.query(*part)[0], bench.query(*part, draw=1)[0])


def test_the_benchmark_of_the_readme_is_evaluated(medium: b4mrl.Client) -> None:
    names: dict[str, object] = {"client": medium, "policy": still}
    exec(program_with("bench.evaluate(policy"), names)
    assert names["scores"].lengths.tolist() == [1000] * 10
    assert names["simulator"].num_envs == 8 and len(names["rewards"]) == 256


def test_an_unknown_benchmark_is_refused_with_the_nearest_name(client: b4mrl.Client) -> None:
    with pytest.raises(errors.UnknownNameError, match=f"did you mean '{re.escape(HIDDEN)}'"):
        client.benchmark("HalfCheetah/confounding/hidden-hihg+medium")


def test_a_benchmark_without_a_name_is_refused(client: b4mrl.Client) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="name is None"):
        client.benchmark(None)


def test_a_missing_dataset_is_the_daemons_error(client: b4mrl.Client) -> None:
    with pytest.raises(errors.UnknownNameError, match="HalfCheetah/random"):
        client.benchmark("HalfCheetah/clean/random").dataset


@pytest.mark.parametrize(
    ("name", "hidden"),
    [
        (HIDDEN, [9]),
        (NOISY, []),
        ("HalfCheetah/clean/medium", []),
        ("HalfCheetah/partial-observability-simulator/hidden-high+medium", []),
        ("HalfCheetah/partial-observability-dataset/gravity+partial-high", [9]),
        ("HalfCheetah/simulators/hidden-high", [9]),
        ("Highway/simulators/hidden-low", [3, 4, 8, 9, 13, 14, 18, 19, 23, 24]),  # vx and vy
    ],
)
def test_the_mask_hides_what_the_training_hid(
    medium: b4mrl.Client, name: str, hidden: list[int]
) -> None:
    bench = medium.benchmark(name)
    spec = medium.environments()[bench.environment]
    assert bench.mask.shape == spec.observation.shape and bench.mask.dtype == np.bool_
    np.testing.assert_array_equal(np.flatnonzero(~bench.mask), hidden)
    with pytest.raises(ValueError, match="read-only"):  # evaluations use the same array
        bench.mask[:] = True


@pytest.mark.parametrize("name", ["17", "-1", "9_0", "\u0669"])
def test_a_mask_refuses_a_dimension_that_a_server_makes_up(
    medium: b4mrl.Client, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    in_force = (NamedArgument("hidden", f"9+{name}"),)
    monkeypatch.setattr(Benchmark, "_seen_through", in_force)
    wanted = f"hidden dimension is '{name}', allowed: a whole number in 0..16"  # as in C++
    with pytest.raises(errors.InvalidArgumentError, match=f"^{re.escape(wanted)}$"):
        medium.benchmark("HalfCheetah/simulators/hidden-high").mask


def test_a_mask_refuses_a_dimension_that_a_dataset_does_not_have(medium: b4mrl.Client) -> None:
    bench = medium.benchmark(HIDDEN)
    bench.dataset.hidden_dimensions = (9, 17)
    wanted = "^the server's reply hides dimension 17 of 17$"  # as in C++
    with pytest.raises(errors.InternalError, match=wanted):
        bench.mask


def test_a_policy_sees_zeros_where_the_mask_hides_unless_it_observes_in_full(
    medium: b4mrl.Client,
) -> None:
    bench = medium.benchmark(HIDDEN)
    for observe, is_hidden in (("trained", True), ("full", False)):
        policy = Recorder()
        bench.evaluate(policy, episodes=2, observe=observe)
        seen = np.array(policy.seen)
        assert seen.shape == (1000, 2, 17) and seen.dtype == np.float32
        assert (not seen[..., 9].any()) == is_hidden
        assert seen[..., [8, 10]].any()
    with pytest.raises(errors.InvalidArgumentError, match="allowed: trained, full, served"):
        bench.evaluate(still, observe="everything")


def test_the_noise_of_the_training_is_served_on_request(medium: b4mrl.Client) -> None:
    bench = medium.benchmark(NOISY)
    first = {}
    for observe in ("trained", "served"):
        policy = Recorder()
        bench.evaluate(policy, episodes=8, observe=observe)
        first[observe] = policy.seen[0]
    noise = first["served"] - first["trained"]
    # 136 normal numbers with standard deviation 0.05: their own varies by 6 percent.
    assert 0.035 < noise.std() < 0.065
    with pytest.raises(errors.InvalidArgumentError, match="trains without noise"):
        medium.benchmark(HIDDEN).evaluate(still, observe="served")


@pytest.mark.parametrize("task", ["HalfCheetah", "Hopper"])
def test_single_observations_and_batches_give_the_same_returns(
    client: b4mrl.Client, task: str
) -> None:
    """HalfCheetah's episodes end together, the Hopper's one after the other."""
    bench = client.benchmark(f"{task}/simulators/gravity")
    spec = client.environments()[task]
    weights = np.random.default_rng(2).normal(scale=0.2, size=(spec.action.size, bench.mask.size))

    def alone(observation: np.ndarray) -> list[float]:
        return [float(np.tanh(row @ observation)) for row in weights]  # raises for a batch

    def together(observations: np.ndarray) -> np.ndarray:
        return np.array([alone(observation) for observation in observations])

    one, many = bench.evaluate(alone, episodes=3), bench.evaluate(together, episodes=3)
    np.testing.assert_array_equal(one.returns, many.returns)
    np.testing.assert_array_equal(one.lengths, many.lengths)
    assert one.score == spec.normalised_score(one.returns.mean()) == many.score
    assert one.std_return == one.returns.std() and one.given_up == 0
    assert (len(set(one.lengths)) > 1) == (task == "Hopper")


def test_a_policy_is_reset_before_its_episodes(client: b4mrl.Client) -> None:
    bench = client.benchmark("HalfCheetah/simulators/gravity")
    together, alone = Recorder(), Recorder(batches=False)
    bench.evaluate(together, episodes=2)
    bench.evaluate(alone, episodes=2)
    assert together.resets == 1
    assert alone.resets == 1 + 2  # once for the batch that it refused


def test_a_policy_that_takes_neither_is_refused_with_both_reasons(client: b4mrl.Client) -> None:
    bench = client.benchmark("HalfCheetah/simulators/gravity")

    def wrong(observations: np.ndarray) -> np.ndarray:
        return np.zeros((*observations.shape[:-1], 5))

    with pytest.raises(errors.InvalidArgumentError, match=r"allowed: \(3, 6\).*allowed: \(6,\)"):
        bench.evaluate(wrong, episodes=3)


@pytest.mark.parametrize("returns", ["abc", {"x": 1}, RAGGED, object()])
def test_returns_that_are_no_numbers_are_refused(returns: object) -> None:
    with pytest.raises(errors.InvalidArgumentError, match="returns are .*allowed|returns is .*all"):
        given_returns(returns)


@pytest.mark.parametrize("policy", [None, 3, b"agent.h5", np.zeros(6)])
def test_what_is_no_policy_is_refused(client: b4mrl.Client, policy: object) -> None:
    bench = client.benchmark("HalfCheetah/simulators/gravity")
    with pytest.raises(errors.InvalidArgumentError, match="^policy is .*allowed: a function"):
        bench.evaluate(policy)


def test_an_error_of_a_policy_in_the_middle_is_the_callers(client: b4mrl.Client) -> None:
    bench = client.benchmark("HalfCheetah/simulators/gravity")
    calls = []

    def failing(observation: np.ndarray) -> np.ndarray:
        if observation.ndim > 1:
            raise TypeError
        calls.append(observation)
        return np.zeros(6) if len(calls) < 10 else 1 / 0

    with pytest.raises(ZeroDivisionError):
        bench.evaluate(failing, episodes=2)


def write_still_agent(path: Path) -> None:
    """An agent whose actions are exactly 0, in any arithmetic."""
    with h5py.File(path, "w", libver=("earliest", "v110")) as file:
        file["metadata/environment"] = b"HalfCheetah"
        policy = file.create_group("metadata/policy")
        policy["nonlinearity"], policy["output_distribution"] = b"relu", b"tanh"
        policy["last_fc/weight"] = np.zeros((6, 17), np.float32)
        policy["last_fc/bias"] = np.zeros(6, np.float32)


@pytest.mark.parametrize("seed", [0, 1])
def test_episodes_start_as_those_of_the_command(
    medium: b4mrl.Client, tmp_path: Path, seed: int
) -> None:
    write_still_agent(tmp_path / "agent.h5")
    command = [Path(find_server()[0]).with_name("b4mrl-tools"), "evaluate", "--json"]
    command += ["--agent", tmp_path / "agent.h5", "--environment", "HalfCheetah"]
    done = subprocess.run(
        [*command, "--episodes", "3", "--seed", str(seed)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    wanted = json.loads(done.stdout)
    bench = medium.benchmark(HIDDEN)
    for policy in (still, tmp_path / "agent.h5", b4mrl.load_agent(tmp_path / "agent.h5")):
        found = bench.evaluate(policy, episodes=3, held_out=seed == 1)
        assert found.returns.tolist() == wanted["returns"]
        assert found.lengths.tolist() == wanted["lengths"]
        assert found.score == pytest.approx(wanted["score"], rel=1e-12)  # sums in another order


def test_an_agent_of_another_environment_is_refused(client: b4mrl.Client, tmp_path: Path) -> None:
    write_still_agent(tmp_path / "agent.h5")
    bench = client.benchmark("Walker2d/simulators/gravity")
    with pytest.raises(errors.InvalidArgumentError, match="'HalfCheetah', allowed: 'Walker2d'"):
        bench.evaluate(tmp_path / "agent.h5")


def test_an_agent_that_observes_in_full_is_without_its_own_mask(tmp_path: Path) -> None:
    write_still_agent(tmp_path / "agent.h5")
    with h5py.File(tmp_path / "agent.h5", "a") as file:
        file["metadata/policy/observation_mask"] = np.arange(17) != 9
        file["metadata/policy/last_fc/weight"][:, 9] = 1
    policy = b4mrl.load_agent(tmp_path / "agent.h5")
    observation = np.eye(17)[9]
    assert not policy(observation).any()
    np.testing.assert_allclose(policy.unmasked()(observation), np.tanh(1), rtol=1e-6)
    assert not policy(observation).any()


def test_policies_are_scored_in_the_benchmarks_world(medium: b4mrl.Client) -> None:
    bench = medium.benchmark("HalfCheetah/action-delay/gravity+action-delay")
    policy = Recorder()
    found = bench.evaluate(policy, episodes=1)
    seed = role_seed(0, "evaluation", 0)
    with medium.make("HalfCheetah", "action-delay") as env:
        observation, total = env.reset(seed=seed)[0], 0.0
        for _ in range(1000):
            observation, reward, *_ = env.step(policy(observation).astype(np.float32))
            total += reward
    assert found.returns[0] == pytest.approx(total, rel=1e-12)  # sums in another order
    undelayed = medium.benchmark("HalfCheetah/clean/medium").evaluate(policy, episodes=1)
    assert found.returns[0] != undelayed.returns[0]


def test_every_environment_gives_the_normalised_score(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", "gravity") as env, client.make_vec("HalfCheetah", 2) as vec:
        for each in (env.unwrapped, vec.unwrapped):
            assert each.normalised_score(each.reference_min) == 0
            assert each.normalised_score(each.reference_max) == 100
    with client.make("Highway") as env:
        assert env.unwrapped.normalised_score(20.0) is None
        assert env.unwrapped.normalised_score([20.0, 30.0]) is None


def test_returns_are_scored_one_by_one_and_as_arrays(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env:
        low, high = env.reference_min, env.reference_max
        scores = env.normalised_score(np.array([[low, high]]))
        assert (scores.dtype, scores.tolist()) == (np.float64, [[0.0, 100.0]])
        assert env.normalised_score([low, high]).tolist() == [0.0, 100.0]
        for number in (3, np.float64(3), np.int64(3), np.array(3.0)):
            assert env.normalised_score(number) == env.normalised_score(3.0)
            assert type(env.normalised_score(number)) is float
        for wrong in (None, "3", [1.0, "a"], RAGGED, {}, object(), 1j):
            with pytest.raises(errors.InvalidArgumentError, match="episode_return is .*allowed"):
                env.normalised_score(wrong)


def test_a_dataset_is_loaded_by_either_rule(medium: b4mrl.Client) -> None:
    with medium.dataset("HalfCheetah/medium", "hidden-high") as dataset:
        stored, d4rl = dataset.load(), dataset.load(transitions="d4rl")
        with medium.dataset("HalfCheetah/medium", "hidden-high", transition_rule="d4rl") as other:
            for name, column in other.load().items():
                np.testing.assert_array_equal(d4rl[name], column)
            for name, column in other.load(transitions="stored").items():
                np.testing.assert_array_equal(stored[name], column)
        assert len(d4rl["rewards"]) < len(stored["rewards"]) == ROWS
        with pytest.raises(errors.UnknownNameError, match="known: stored, d4rl"):
            dataset.load(transitions="own")
        with pytest.raises(errors.InvalidArgumentError, match="^transitions is 3, allowed"):
            dataset.load(transitions=3)


@pytest.mark.parametrize(
    ("name", "corruption", "hidden"),
    [
        ("HalfCheetah/medium", "hidden=9+10,obs-noise=0.1", [9, 10]),
        ("HalfCheetah/partial-high", "obs-noise=0.1", [9]),  # by its behaviour policy
    ],
)
def test_what_is_hidden_stays_hidden_from_noise(
    medium: b4mrl.Client, name: str, corruption: str, hidden: list[int]
) -> None:
    with medium.dataset(name, corruption) as dataset:
        assert list(dataset.hidden_dimensions) == hidden
        for column in ("observations", "next_observations"):
            still_zero = ~dataset[:50][column].any(axis=0)
            assert np.flatnonzero(still_zero).tolist() == hidden


def statistics(mean: float = 1.0) -> DatasetStats:
    column = np.array([mean, 2.0])
    return DatasetStats(column, column, 2, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def evaluation(score: float = 1.0) -> Evaluation:
    return Evaluation(score, 3.0, 0.0, np.array([3.0, 3.0]), np.array([5, 5]), 0)


@pytest.mark.parametrize("make", [statistics, evaluation])
def test_statistics_and_scores_are_equal_if_all_their_numbers_are(make) -> None:
    assert make() == make() != make(7.0)
    assert len({make(), make(), make(7.0)}) == 2
    assert make(0.0) == make(-0.0) and hash(make(0.0)) == hash(make(-0.0))


def test_type_checkers_let_a_learner_use_the_dataset_at_once() -> None:
    """`bench.dataset.sample(256)` passes them, although a benchmark may have no dataset."""
    hints = typing.get_type_hints(Benchmark.dataset.fget, vars(b4mrl.benchmarks.benchmark))
    assert hints["return"] == Dataset | typing.Any
