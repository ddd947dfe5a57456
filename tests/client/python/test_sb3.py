"""The adapter to Stable-Baselines3, against its own DummyVecEnv and checkers."""

from __future__ import annotations

import warnings
from collections.abc import Callable

import b4mrl
import numpy as np
import pytest
from b4mrl import errors

from equality import assert_same
from test_documents import program_with

pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")

from b4mrl.sb3 import StableBaselinesVecEnv  # noqa: E402
from stable_baselines3 import SAC  # noqa: E402
from stable_baselines3.common.env_checker import check_env  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor  # noqa: E402


def batch(client: b4mrl.Client, environment: str, *arguments, **options) -> StableBaselinesVecEnv:
    vec = client.make_vec(environment, *arguments, autoreset_mode="same_step", **options)
    return StableBaselinesVecEnv(vec)


def test_its_checker_passes(client: b4mrl.Client, environment: str, simulator: str) -> None:
    with client.make(environment, simulator) as env, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of bounds that Gymnasium's own tasks have as well
        check_env(env, skip_render_check=True)


def test_it_equals_dummy_vec_env(client: b4mrl.Client, environment: str) -> None:
    ours = batch(client, environment, 3)
    dummy = DummyVecEnv([lambda: client.make(environment)] * 3)
    ours.seed(7)
    dummy.seed(7)
    assert_same(ours.reset(), dummy.reset())
    # Long enough for the end of an episode in every environment.
    for i in range(1_100):
        actions = np.stack([ours.action_space.sample() for _ in range(3)])
        for name, mine, theirs in zip(
            ("observations", "rewards", "dones", "infos"), ours.step(actions), dummy.step(actions)
        ):
            assert_same(mine, theirs, f"{name} of step {i}")
        assert_same(ours.reset_infos, dummy.reset_infos)
    ours.close()
    dummy.close()


def test_it_trains(client: b4mrl.Client, environment: str) -> None:
    vec = VecMonitor(batch(client, environment, 4, simulator="obs-noise=0.01"))
    model = SAC("MlpPolicy", vec, learning_starts=100, policy_kwargs={"net_arch": [32]}, seed=1)
    before = model.policy.actor.state_dict()["mu.bias"].clone()
    model.learn(400)
    assert model.num_timesteps >= 400
    assert not np.allclose(before, model.policy.actor.state_dict()["mu.bias"])
    vec.close()


def test_the_learner_of_the_readme_logs_the_returns_of_its_episodes(client: b4mrl.Client) -> None:
    program = program_with("StableBaselinesVecEnv").replace("100_000", "80")
    program = program.replace("autoreset_mode=", "max_episode_steps=5, autoreset_mode=")
    names: dict[str, object] = {"client": client}
    exec(program, names)
    assert len(names["model"].ep_info_buffer) == 16  # ep_rew_mean is their mean
    names["vec"].close()


def test_it_evaluates(client: b4mrl.Client) -> None:
    vec = VecMonitor(batch(client, "HalfCheetah", 2))
    model = SAC("MlpPolicy", vec, policy_kwargs={"net_arch": [8]})
    returns, lengths = evaluate_policy(model, vec, 4, return_episode_rewards=True)
    assert lengths == [1000] * 4
    assert np.isfinite(returns).all()
    vec.close()


def interrupt(call: Callable[[], object], place: str) -> None:
    """Makes `call`, into which Ctrl-C comes where it enters `place`."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(place, interrupted)
        with pytest.raises(KeyboardInterrupt):
            call()


@pytest.mark.parametrize(
    "place",
    [
        "b4mrl.sb3.StableBaselinesVecEnv.step_wait",  # between the halves of a step
        "b4mrl.wire.connection.Connection.await_any",  # the reply is waited for
        "b4mrl.infos.row_of",  # the outcome is read
    ],
)
def test_it_can_be_used_after_ctrl_c(client: b4mrl.Client, place: str) -> None:
    ours, twin = batch(client, "HalfCheetah", 2), batch(client, "HalfCheetah", 2)
    actions = np.full((2, 6), 0.5, np.float32)
    for vec in (ours, twin):
        vec.seed(3)
        vec.reset()
    interrupt(lambda: ours.step(actions), place)
    if not place.endswith("row_of"):  # behind it, the batch has returned the step's outcome
        assert_same(ours.step(actions)[0], twin.step(actions)[0])
    states = ours.env_method("get_state")
    interrupt(lambda: ours.step(actions), place)
    ours.env_method("set_state", states[0])
    interrupt(lambda: ours.step(actions), place)
    for vec in (ours, twin):
        vec.seed(4)
    assert_same(ours.reset(), twin.reset())
    assert_same(ours.step(actions)[:2], twin.step(actions)[:2])
    ours.close()
    twin.close()


def test_learning_goes_on_after_ctrl_c(client: b4mrl.Client) -> None:
    vec = VecMonitor(batch(client, "HalfCheetah", 2))
    model = SAC("MlpPolicy", vec, learning_starts=100, policy_kwargs={"net_arch": [8]})
    interrupt(lambda: model.learn(40), "stable_baselines3.common.vec_env.VecMonitor.step_wait")
    assert model.learn(40).num_timesteps == 40
    vec.close()


def test_recorders_of_videos_find_what_they_need(client: b4mrl.Client) -> None:
    vec = batch(client, "HalfCheetah", 2, render_mode="rgb_array", width=32, height=32)
    assert vec.metadata["render_fps"] == 20 and "rgb_array" in vec.metadata["render_modes"]
    vec.close()


def test_options_of_a_reset_are_refused(client: b4mrl.Client) -> None:
    vec = batch(client, "HalfCheetah", 2)
    vec.reset()
    vec.set_options([{}, {"config": {"max_episode_steps": 3}}])
    with pytest.raises(errors.InvalidArgumentError, match="options is .*max_episode_steps"):
        vec.reset()
    vec.set_options()
    vec.reset()
    vec.close()


def test_another_mode_is_refused(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        with pytest.raises(errors.InvalidArgumentError, match="same_step"):
            StableBaselinesVecEnv(vec)


def test_a_single_environment_needs_no_adapter(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env:
        with pytest.raises(errors.InvalidArgumentError, match="make_vec.*make needs no adapter"):
            StableBaselinesVecEnv(env)
        model = SAC("MlpPolicy", env, learning_starts=20, policy_kwargs={"net_arch": [8]})
        assert model.learn(40).num_timesteps == 40


def test_attributes_are_those_of_the_batch(client: b4mrl.Client) -> None:
    vec = batch(client, "HalfCheetah", 3)
    vec.reset()
    assert vec.get_attr("num_envs", [0, 2]) == [3, 3]
    dummy = DummyVecEnv([lambda: client.make("HalfCheetah")])
    for name in ("observation_space", "action_space"):
        assert vec.get_attr(name) == dummy.get_attr(name) * 3
    dummy.close()
    assert vec.env_is_wrapped(VecMonitor) == [False] * 3
    states = vec.env_method("get_state", indices=[2, 0])
    vec.env_method("set_state", states[0], indices=[1])
    np.testing.assert_array_equal(
        vec.env_method("get_state", indices=1)[0]["qpos"], states[0]["qpos"]
    )
    for given in ((), (states[0], states[0])):
        with pytest.raises(errors.InvalidArgumentError, match="allowed: 1, the state"):
            vec.env_method("set_state", *given)
    with pytest.raises(errors.UnsupportedError):
        vec.env_method("jump")
    with pytest.raises(errors.UnsupportedError):
        vec.set_attr("colour", 1, indices=[0])
    vec.close()
