"""pickle and copy: new environments, opened by the same arguments."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from typing import Any

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
from b4mrl import errors, simulators

from equality import assert_same

copies = pytest.mark.parametrize(
    "make_copy", [copy.copy, copy.deepcopy, lambda it: pickle.loads(pickle.dumps(it))]
)


@copies
def test_a_copied_environment_is_a_new_one_of_the_same_kind(
    client: b4mrl.Client, make_copy: Callable[[Any], Any]
) -> None:
    config = {"max_episode_steps": 5, "reset_noise_scale": 0.2}
    with client.make("HalfCheetah", {"gravity": 2}, dtype="float64", config=config, seed=3) as env:
        env.reset()
        env.step(np.ones(6))
        with make_copy(env) as twin:
            assert twin.session.in_force.config == env.session.in_force.config
            assert twin.session.in_force.experiment_id == env.session.in_force.experiment_id
            assert_same(twin.reset(seed=3), env.reset(seed=3))
            assert_same(twin.step(np.ones(6)), env.step(np.ones(6)))
        env.step(np.ones(6))  # which the copy's end does not concern


@copies
def test_a_copy_has_the_deadline_of_its_original(
    client: b4mrl.Client, make_copy: Callable[[Any], Any]
) -> None:
    with (
        client.make("HalfCheetah", deadline_ms=5000) as env,
        make_copy(env) as twin,
        client.make_vec("HalfCheetah", 2, deadline_ms=5000) as vec,
        make_copy(vec) as vec_twin,
    ):
        assert twin.session.deadline_ms == vec_twin.session.deadline_ms == 5000
        again = gym.make(env.spec)
        again.close()
    made = gym.make("b4mrl/HalfCheetah-v0", endpoint=client.endpoint, deadline_ms=1e12)
    made.reset(seed=1)
    made.close()


@copies
def test_what_the_caller_changes_later_concerns_no_copy(
    client: b4mrl.Client, make_copy: Callable[[Any], Any]
) -> None:
    config = {"max_episode_steps": np.int64(5), "healthy_z_range": np.array([0.5, np.inf])}
    simulator = {"gravity": 2, "hidden": [1]}
    with client.make("Hopper", simulator, config=config, seed=np.int64(3)) as env:
        config["max_episode_steps"] = 7
        config["healthy_z_range"][0] = 0.1
        simulator["gravity"] = 1
        simulator["hidden"].append(2)
        env.spec.kwargs["config"]["max_episode_steps"] = 9
        again = make_copy(env)
        assert again.session.in_force.experiment_id == env.session.in_force.experiment_id
        assert again.spec.kwargs["seed"] == 3
        again.close()


def test_a_spec_becomes_json_and_makes_the_same_again(client: b4mrl.Client) -> None:
    options = {
        "simulator": [("gravity", np.float64(2)), {"hidden": np.array([1, 2])}],
        "config": {"healthy_z_range": np.array([0.5, np.inf]), "max_episode_steps": np.int64(5)},
        "seed": np.int64(3),
        "dtype": np.float64,
        "width": np.int32(32),
    }
    own = client.make("Hopper", **options)
    registered = gym.make("b4mrl:b4mrl/Hopper-v0", endpoint=client.endpoint, **options)
    for env in (own, registered):
        with env, gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json())) as again:
            forces = [it.unwrapped.session.in_force for it in (env, again)]
            assert forces[0].experiment_id == forces[1].experiment_id


def test_a_value_with_a_comma_stays_one() -> None:
    for simulator in ({"model": "a,b.xml"}, {"model": "a b.xml ", "gravity": None}):
        assert simulators.parse(simulators.plain(simulator)) == simulators.parse(simulator)
    assert simulators.plain({"gravity": 2, "leg-low": None}) == "gravity=2,leg-low"


@copies
def test_so_is_a_copied_batch(client: b4mrl.Client, make_copy: Callable[[Any], Any]) -> None:
    options = {"autoreset_mode": "same_step", "seed": 4, "max_episode_steps": 3}
    with client.make_vec("Hopper", 3, "gravity", **options) as vec, make_copy(vec) as twin:
        assert_same(vec.reset(), twin.reset())
        for _ in range(5):
            actions = vec.action_space.sample()
            assert_same(vec.step(actions), twin.step(actions))


@copies
def test_a_copy_needs_neither_client_nor_environment(
    endpoint: str, make_copy: Callable[[Any], Any]
) -> None:
    with b4mrl.connect(endpoint) as client, client.make("HalfCheetah", seed=9) as env:
        first = env.reset()
    again = make_copy(env)
    assert_same(again.reset(), first)
    again.close()
    with pytest.raises(errors.FailedPreconditionError):
        env.reset()


def test_an_environment_under_gymnasiums_wrappers_is_copied_with_them(endpoint: str) -> None:
    with gym.make("b4mrl:b4mrl/HalfCheetah-v0", endpoint=endpoint, simulator="gravity") as env:
        wrapped = gym.wrappers.RecordEpisodeStatistics(env)
        with copy.deepcopy(wrapped) as twin:
            assert_same(wrapped.reset(seed=1), twin.reset(seed=1))
            assert twin.unwrapped.session.in_force.perturbations[0].name == "gravity"


def test_an_environment_can_be_sent_to_another_process(client: b4mrl.Client) -> None:
    program = "import pickle, sys; env = pickle.load(sys.stdin.buffer); print(env.reset()[0][0])"
    with client.make("HalfCheetah", seed=1) as env:
        done = subprocess.run(
            [sys.executable, "-c", program], input=pickle.dumps(env), capture_output=True
        )
        assert (done.stderr, float(done.stdout)) == (b"", pytest.approx(env.reset()[0][0]))


def test_a_client_can_be_sent_to_another_process(client: b4mrl.Client) -> None:
    program = (
        "import pickle, sys; client = pickle.load(sys.stdin.buffer); "
        "print(client.make('HalfCheetah', seed=1).reset()[0][0])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], input=pickle.dumps(client), capture_output=True
    )
    with client.make("HalfCheetah", seed=1) as env:
        assert (done.stderr, float(done.stdout)) == (b"", pytest.approx(env.reset()[0][0]))
