"""Pictures of environments."""

from __future__ import annotations

import warnings

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
from b4mrl import errors
from gymnasium.utils.env_checker import check_env


def test_a_picture_shows_the_present_state(client: b4mrl.Client, environment: str) -> None:
    with client.make(environment, render_mode="rgb_array") as env:
        env.reset(seed=1)
        spec = env.session.spec
        first = env.render()
        assert first.shape == (spec.picture_height, spec.picture_width, 3)
        assert first.dtype == np.uint8
        assert len(np.unique(first.reshape(-1, 3), axis=0)) > 3  # more than an empty page
        np.testing.assert_array_equal(env.render(), first)
        state = env.get_state()
        for _ in range(10):
            env.step(env.action_space.sample())
        assert not np.array_equal(env.render(), first)
        env.set_state(state)
        np.testing.assert_array_equal(env.render(), first)


def test_a_picture_shows_the_number_that_the_episode_drew(client: b4mrl.Client) -> None:
    options = {"render_mode": "rgb_array", "width": 96, "height": 96}
    with client.make_vec("Hopper", 3, "leg=0.3..2", seed=1, **options) as ranged:
        _, infos = ranged.reset()
        pictures = ranged.render()
        for lane, length in enumerate(infos["leg"]):
            with client.make("Hopper", {"leg": length}, seed=1 + lane, **options) as fixed:
                fixed.reset()
                np.testing.assert_array_equal(pictures[lane], fixed.render())
        with client.make("Hopper", seed=1, **options) as whole:
            whole.reset()
            assert not np.array_equal(pictures[0], whole.render())


def test_pictures_have_the_size_that_was_asked_for(client: b4mrl.Client, environment: str) -> None:
    options = {"render_mode": "rgb_array", "width": 96, "height": 64}
    with (
        client.make_vec(environment, 3, **options) as vec,
        client.make(environment, **options) as env,
    ):
        vec.reset(seed=5)
        env.reset(seed=6)
        pictures = vec.render()
        assert [picture.shape for picture in pictures] == [(64, 96, 3)] * 3
        np.testing.assert_array_equal(pictures[1], env.render())


def test_another_mode_is_refused_before_anything_is_opened(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("b4mrl.client.open_session", None)
    for make in (client.make, client.make_vec):
        with pytest.raises(errors.InvalidArgumentError, match="'human', allowed: None, rgb_array"):
            make("HalfCheetah", render_mode="human")


def test_gymnasiums_checker_renders_as_well(endpoint: str, environment: str) -> None:
    name = f"b4mrl:b4mrl/{environment}-v0"
    with gym.make(name, endpoint=endpoint, render_mode="rgb_array") as env:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of infinite bounds, which the originals have as well
            check_env(env.unwrapped)


def test_without_a_render_mode_there_is_no_picture(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        env.reset()
        assert env.render() is None
        assert vec.render() is None


@pytest.mark.parametrize("size", [8, 100_000, -1, 96.0, "96"])
def test_a_size_that_cannot_be_is_refused_before_anything_is_opened(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch, size: object
) -> None:
    monkeypatch.setattr("b4mrl.client.open_session", None)
    for make in (client.make, client.make_vec):
        for side in ("width", "height"):
            with pytest.raises(errors.InvalidArgumentError) as caught:
                make("HalfCheetah", render_mode="rgb_array", **{side: size})
            assert str(caught.value).startswith(f"{side} is {size!r}, allowed: 16..1920 pixels")


def test_before_the_first_reset_there_is_nothing_to_see(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", render_mode="rgb_array") as env:
        with pytest.raises(errors.FailedPreconditionError):
            env.render()
