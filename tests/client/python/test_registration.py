"""Gymnasium's registry: specs that tell the truth."""

from __future__ import annotations

import gc
import pickle
import weakref

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
from b4mrl import errors

NAME = "b4mrl:b4mrl/{}-v0"


def steps_until_the_end(env: gym.Env) -> int:
    env.reset(seed=0)
    steps = 0
    ended = False
    while not ended:
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, np.float32))
        steps += 1
        ended = terminated or truncated
    assert info["cause"] == "limit"  # in the daemon's own words
    return steps


def test_a_client_of_a_private_daemon_keeps_it() -> None:
    client = b4mrl.connect(b4mrl.serve(workers=1))
    daemon = weakref.ref(client._daemon)
    gc.collect()
    assert daemon().is_running and client.endpoint == daemon().endpoint
    with client.make("HalfCheetah") as env:
        env.reset(seed=1)
    with pickle.loads(pickle.dumps(client)) as copy:  # which knows the address alone
        assert copy.endpoint == client.endpoint
    del client
    gc.collect()
    assert daemon() is None


@pytest.mark.parametrize("limit", [3, 1200])
def test_max_episode_steps_reaches_the_daemon_and_the_spec(endpoint: str, limit: int) -> None:
    with gym.make(NAME.format("HalfCheetah"), limit, endpoint=endpoint) as env:
        assert env.spec.max_episode_steps == limit
        assert env.unwrapped.spec.max_episode_steps == limit
        assert env.unwrapped.session.spec.max_episode_steps == limit
        assert steps_until_the_end(env) == limit


def test_a_task_that_counts_seconds_has_it_too(endpoint: str) -> None:
    with gym.make(NAME.format("Highway"), 3, endpoint=endpoint) as env:
        assert env.unwrapped.session.spec.max_episode_steps == 3
        assert env.spec.max_episode_steps == 3


def test_without_it_the_spec_has_the_tasks_own(client: b4mrl.Client, environment: str) -> None:
    own = client.environments()[environment].max_episode_steps
    with gym.make(NAME.format(environment), endpoint=client.endpoint) as env:
        assert env.spec.max_episode_steps == own
    with client.make(environment) as env, client.make_vec(environment, 2) as vec:
        assert env.spec.max_episode_steps == vec.spec.max_episode_steps == own


def test_minus_one_lifts_the_limit_of_steps(client: b4mrl.Client, environment: str) -> None:
    own = client.environments()[environment]
    wanted = own.max_episode_steps if environment == "Highway" else 0  # no limit
    options = {"endpoint": client.endpoint, "max_episode_steps": -1}
    with gym.make(NAME.format(environment), **options) as env, gym.make(env.spec) as again:
        for each in (env, again):
            assert each.unwrapped.session.spec.max_episode_steps == wanted
            assert each.spec.max_episode_steps == (wanted or None)  # as Gymnasium has it
        if environment == "HalfCheetah":
            again.reset(seed=0)
            for _ in range(own.max_episode_steps + 1):
                assert not again.step(np.zeros(6, np.float32))[3]
    with client.make_vec(environment, 2, max_episode_steps=-1) as vec:
        assert vec.spec.max_episode_steps == (wanted or None)
        again = gym.make_vec(vec.spec)
        assert again.session.spec.max_episode_steps == wanted
        again.close()


def test_what_the_settings_say_is_in_the_spec(endpoint: str) -> None:
    config = {"max_episode_steps": 4}
    with gym.make(NAME.format("HalfCheetah"), endpoint=endpoint, config=config) as env:
        assert env.spec.max_episode_steps == 4
        assert steps_until_the_end(env) == 4


def test_the_two_must_not_differ(client: b4mrl.Client) -> None:
    config = {"max_episode_steps": 4}
    client.make("HalfCheetah", config=config, max_episode_steps=4).close()
    with pytest.raises(errors.InvalidArgumentError, match="is 5 and config"):
        client.make("HalfCheetah", config=config, max_episode_steps=5)
    with pytest.raises(errors.InvalidArgumentError, match="is -1 and config"):
        client.make("HalfCheetah", config=config, max_episode_steps=-1)
    with pytest.raises(errors.InvalidArgumentError, match="max_episode_steps is -3"):
        client.make("HalfCheetah", max_episode_steps=-3)


def test_gymnasiums_own_render_modes_come_with_rgb_array(endpoint: str) -> None:
    sizes = {"width": 32, "height": 16, "endpoint": endpoint}
    with gym.make(NAME.format("HalfCheetah"), render_mode="rgb_array_list", **sizes) as env:
        env.reset(seed=1)
        env.step(env.action_space.sample())
        assert [frame.shape for frame in env.render()] == [(16, 32, 3)] * 2
        assert env.unwrapped.render_mode == "rgb_array"
        assert env.unwrapped.metadata["render_fps"] == 20


@pytest.mark.parametrize("how", ["vector_entry_point", "sync"])
def test_make_vec_has_it_as_well(endpoint: str, how: str) -> None:
    options = {"endpoint": endpoint, "vectorization_mode": how, "max_episode_steps": 1001}
    vec = gym.make_vec(NAME.format("HalfCheetah"), 2, **options)
    vec.reset(seed=0)
    for step in range(1001):
        truncated = vec.step(np.zeros((2, 6), np.float32))[3]
        assert truncated.all() == (step == 1000)
    assert how == "sync" or vec.spec.max_episode_steps == 1001
    vec.close()


@pytest.mark.parametrize("is_default", [True, False])
def test_a_spec_names_no_daemon_that_others_need_not_find(
    monkeypatch: pytest.MonkeyPatch, client: b4mrl.Client, is_default: bool
) -> None:
    monkeypatch.setenv("B4MRL_ENDPOINT", client.endpoint if is_default else "tcp://127.0.0.1:1")
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        for spec in (env.spec, vec.spec):
            assert spec.kwargs.get("endpoint") == (None if is_default else client.endpoint)
        with gym.make(env.spec) as again:
            assert again.unwrapped.session.in_force.environment == "HalfCheetah"


def test_a_spec_makes_the_same_again(client: b4mrl.Client, environment: str) -> None:
    with client.make(environment, "obs-noise=0.1", seed=1, max_episode_steps=7) as env:
        with gym.make(env.spec) as again:
            ours, theirs = env.session.in_force, again.unwrapped.session.in_force
            assert ours.experiment_id == theirs.experiment_id
            assert again.spec.max_episode_steps == 7
    with client.make_vec(environment, 3, "obs-noise=0.1") as vec:
        again = gym.make_vec(vec.spec)
        assert again.num_envs == 3
        assert again.unwrapped.session.in_force.perturbations == vec.session.in_force.perturbations
        again.close()
