"""Batches against SyncVectorEnv over single environments, in each auto-reset mode."""

from __future__ import annotations

import typing

import b4mrl
import numpy as np
import pytest
from b4mrl import VectorEnvironment, errors, vector_environment
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from equality import assert_same

LANES = 3

# Steps of a comparison: of the short form, of the true environments, and of perturbed ones.
SHORT, LONG, LONG_PERTURBED = 150, 10_000, 2_000


# Episodes that end soon, where the environment has that setting.
BRIEF = {"max_episode_steps": 37}


def pair(client: b4mrl.Client, environment: str, simulator: str, mode: str, dtype: str):
    """The batch, and the same by Gymnasium over single environments."""
    options = {"dtype": dtype, "config": BRIEF if shortens(client, environment) else None}
    batch = client.make_vec(environment, LANES, simulator, autoreset_mode=mode, **options)
    singles = [lambda: client.make(environment, simulator, **options)] * LANES
    return batch, SyncVectorEnv(singles, autoreset_mode=AutoresetMode[mode.upper()])


def shortens(client: b4mrl.Client, environment: str) -> bool:
    try:
        client.make(environment, config=BRIEF).close()
    except errors.UnknownNameError:
        return False
    return True


def test_a_batch_equals_gymnasiums_over_single_environments(
    client: b4mrl.Client, environment: str, simulator: str, mode: str, long: bool
) -> None:
    batch, singles = pair(client, environment, simulator, mode, "float64")
    assert batch.metadata["autoreset_mode"] == AutoresetMode[mode.upper()]
    for space in ("observation_space", "action_space"):
        assert getattr(batch, space) == getattr(singles, space)
        assert getattr(batch, "single_" + space) == getattr(singles, "single_" + space)
    assert_same(batch.reset(seed=11), singles.reset(seed=11), "reset")
    batch.action_space.seed(0)
    ends = 0
    steps = (LONG_PERTURBED if simulator else LONG) if long else SHORT
    for i in range(steps):
        actions = batch.action_space.sample()
        result = batch.step(actions)
        assert_same(result, singles.step(actions), f"step {i}")
        ended = result[2] | result[3]
        ends += ended.sum()
        if mode == "disabled" and ended.any():
            masked = batch.reset(options={"reset_mask": ended.copy()})
            assert_same(masked, singles.reset(options={"reset_mask": ended}), f"reset at {i}")
    if shortens(client, environment):
        assert ends >= 3
    batch.close()
    singles.close()


def test_a_partial_reset_equals_gymnasiums(
    client: b4mrl.Client, environment: str, simulator: str, mode: str
) -> None:
    batch, singles = pair(client, environment, simulator, mode, "float32")
    assert_same(batch.reset(seed=[5, 9, 5]), singles.reset(seed=[5, 9, 5]))
    for i in range(60):
        actions = batch.action_space.sample()
        result = batch.step(actions)
        assert_same(result, singles.step(actions))
        if i % 7 == 0 or mode == "disabled" and (result[2] | result[3]).any():
            mask = np.array([i % 2 == 0, True, False]) | result[2] | result[3]
            seed = [None, 100 + i, None]
            assert_same(
                batch.reset(seed=seed, options={"reset_mask": mask.copy()}),
                singles.reset(seed=seed, options={"reset_mask": mask}),
            )
    batch.close()
    singles.close()


def test_a_mask_may_be_a_list(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 3) as vec, client.make_vec("HalfCheetah", 3) as twin:
        assert_same(vec.reset(seed=1), twin.reset(seed=1))
        mask = [True, False, False]
        again = vec.reset(options={"reset_mask": mask})
        assert_same(again, twin.reset(options={"reset_mask": np.array(mask)}))
        assert_same(vec.step(np.zeros((3, 6))), twin.step(np.zeros((3, 6))))


@pytest.mark.parametrize("mask", [np.array([1, 0, 0]), np.zeros(3, bool), np.ones(2, bool)])
def test_a_mask_that_is_none_is_refused(client: b4mrl.Client, mask) -> None:
    with client.make_vec("HalfCheetah", 3) as vec:
        vec.reset()
        with pytest.raises(errors.InvalidArgumentError, match="reset_mask"):
            vec.reset(options={"reset_mask": mask})


def test_other_options_are_refused(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        with pytest.raises(errors.InvalidArgumentError, match="options"):
            vec.reset(options={"reset_mask": np.ones(2, bool), "config": {}})
        vec.reset(options={})


def test_stepping_a_finished_environment_is_refused_in_mode_disabled(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2, autoreset_mode="disabled", config=BRIEF) as vec:
        vec.reset(seed=0)
        actions = np.zeros((2, 6), np.float32)
        for _ in range(vec.session.spec.max_episode_steps):
            vec.step(actions)
        with pytest.raises(errors.FailedPreconditionError, match="environment 0 has ended"):
            vec.step(actions)
        with pytest.raises(errors.FailedPreconditionError, match="environment 1 has ended"):
            vec.send(actions[:1], [1])
        vec.reset(options={"reset_mask": np.array([False, True])})
        vec.send(actions[:1], [1])
        vec.recv()


def test_step_past_end_lets_finished_environments_go_on(client: b4mrl.Client) -> None:
    options = {"autoreset_mode": AutoresetMode.DISABLED, "step_past_end": True, "config": BRIEF}
    with client.make_vec("HalfCheetah", 2, **options) as vec:
        vec.reset(seed=0)
        for _ in range(vec.session.spec.max_episode_steps + 2):
            truncated = vec.step(np.zeros((2, 6), np.float32))[3]
        assert truncated.all()


def test_a_restored_state_is_as_finished_as_it_was(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2, autoreset_mode="disabled", config=BRIEF) as vec:
        vec.reset(seed=0)
        running = vec.get_state()
        for _ in range(vec.session.spec.max_episode_steps):
            vec.step(np.zeros((2, 6), np.float32))
        finished = vec.get_state()
        vec.set_state(running)
        vec.step(np.zeros((2, 6), np.float32))
        vec.set_state([finished[1]], env_ids=[1])
        with pytest.raises(errors.FailedPreconditionError, match="environment 1"):
            vec.step(np.zeros((2, 6), np.float32))


def test_sends_for_different_environments_are_under_way_together(client: b4mrl.Client) -> None:
    with (
        client.make_vec("HalfCheetah", 4, seed=3) as split,
        client.make_vec("HalfCheetah", 4, seed=3) as whole,
    ):
        split.reset()
        whole.reset()
        for _ in range(20):
            actions = split.action_space.sample()
            split.send(actions[[2, 0]], [2, 0])
            split.send(actions[[3, 1]], np.array([3, 1]))
            with pytest.raises(errors.BusyError, match="call recv first"):
                split.send(actions[:1], [0])
            wanted = whole.step(actions)
            seen = []
            for _ in range(2):
                *result, info = split.recv()
                ids = info["env_id"]
                seen += ids.tolist()
                for mine, all_of_them in zip(result, wanted):
                    np.testing.assert_array_equal(mine, all_of_them[ids])
            assert sorted(seen) == [0, 1, 2, 3]
        np.testing.assert_array_equal(split.digests, whole.digests)
        with pytest.raises(errors.FailedPreconditionError):
            split.recv()


def test_infos_of_recv_have_one_entry_for_each_of_its_environments(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 3, autoreset_mode="same_step", config=BRIEF) as vec:
        vec.reset(seed=0)
        limit = vec.session.spec.max_episode_steps
        for _ in range(limit - 1):
            vec.step(np.zeros((3, 6), np.float32))
        vec.send(np.zeros((2, 6), np.float32), [2, 1])
        *_, info = vec.recv()
        assert info["env_id"].tolist() == [2, 1]
        assert info["_final_obs"].tolist() == [True, True]
        assert info["final_info"]["cause"].tolist() == ["limit", "limit"]


def test_a_failed_send_names_its_environments(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset()
        vec.send(np.full((1, 6), np.nan), [1])
        with pytest.raises(errors.InvalidArgumentError) as caught:
            vec.recv()
        assert caught.value.env_ids.tolist() == [1]
        vec.step(np.zeros((2, 6)))  # nothing was executed, so all can go on


@pytest.mark.parametrize("env_ids", [[2], [-1], [[0]], [0.0], "0", []])
def test_environments_that_are_not_there_are_refused(client: b4mrl.Client, env_ids) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset()
        with pytest.raises(errors.InvalidArgumentError):
            vec.send(np.zeros((1, 6)), env_ids)


@pytest.mark.parametrize("shape", [(2, 5), (3, 6), (6,), (2, 6, 1)])
def test_actions_of_another_shape_are_refused(client: b4mrl.Client, shape) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset()
        with pytest.raises(errors.InvalidArgumentError, match="allowed: "):
            vec.step(np.zeros(shape))


@pytest.mark.parametrize("num_envs", [0, -1, 2000, 1.5])
def test_a_number_of_environments_that_cannot_be_is_refused(client, num_envs) -> None:
    with pytest.raises(errors.InvalidArgumentError) as caught:
        client.make_vec("HalfCheetah", num_envs)
    assert str(caught.value) == f"num_envs is {num_envs}, allowed: an integer in 1..1024"


def test_returned_arrays_are_the_callers(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2, autoreset_mode="disabled") as vec:
        observations = vec.reset(seed=0)[0]
        kept = observations.copy()
        observations[:] = 7
        rest = vec.reset(options={"reset_mask": np.array([True, False])})[0]
        np.testing.assert_array_equal(rest[1], kept[1])
        stepped = vec.step(np.zeros((2, 6)))[0]
        kept = stepped.copy()
        stepped[:] = 7
        rest = vec.reset(options={"reset_mask": np.array([True, False])})[0]
        np.testing.assert_array_equal(rest[1], kept[1])


def test_states_are_read_beside_as_many_sends_as_there_may_be(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 66) as vec, client.make_vec("HalfCheetah", 66) as twin:
        vec.reset(seed=1)
        twin.reset(seed=1)
        actions = vec.action_space.sample()
        for i in range(64):
            vec.send(actions[i : i + 1], [i])
        twin.send(actions[:64], range(64))
        wanted = twin.recv()[0]
        assert_same(vec.get_state([64]), twin.get_state([64]))
        with pytest.raises(errors.LimitExceededError):
            vec.send(actions[65:], [65])
        assert_same(vec.get_state(), twin.get_state())  # now all of them are answered
        assert_same(vec.get_state([64]), twin.get_state([64]))
        for _ in range(64):
            observations, *_, info = vec.recv()
            assert_same(observations, wanted[info["env_id"]])
        np.testing.assert_array_equal(vec.digests, twin.digests)


def test_digests_that_a_caller_kept_stay_as_they_were(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset(seed=0)
        kept = vec.digests
        wanted = kept.copy()
        vec.step(np.zeros((2, 6)))
        np.testing.assert_array_equal(kept, wanted)
        assert not np.any(vec.digests == wanted)


@pytest.mark.parametrize("member", list(AutoresetMode))
def test_a_mode_is_gymnasiums_member_its_value_or_its_name(
    client: b4mrl.Client, member: AutoresetMode
) -> None:
    for written in (member, member.value, member.name, member.name.lower()):
        with client.make_vec("HalfCheetah", 2, autoreset_mode=written) as vec:
            assert vec.metadata["autoreset_mode"] == member


@pytest.mark.parametrize("given", ["Same_Stp", None, 3])
def test_a_mode_that_is_none_is_named_as_it_was_given(client: b4mrl.Client, given: object) -> None:
    with pytest.raises(errors.InvalidArgumentError) as caught:
        client.make_vec("HalfCheetah", 2, autoreset_mode=given)
    assert f"autoreset_mode is {given!r}, allowed: next_step, same_step," in str(caught.value)


def test_seeds_may_be_an_array_for_type_checkers_too(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        assert_same(vec.reset(seed=np.array([5, 9])), vec.reset(seed=[5, 9]))
    given = typing.get_type_hints(VectorEnvironment.reset, vars(vector_environment))["seed"]
    assert np.ndarray in map(typing.get_origin, typing.get_args(given))


def test_it_is_registered_for_make_vec(endpoint: str) -> None:
    import gymnasium as gym

    vec = gym.make_vec(
        "b4mrl:b4mrl/HalfCheetah-v0",
        num_envs=3,
        endpoint=endpoint,
        simulator="gravity",
        autoreset_mode="same_step",
    )
    assert isinstance(vec, b4mrl.VectorEnvironment)
    vec = gym.wrappers.vector.RecordEpisodeStatistics(vec)
    vec.reset(seed=1)
    vec.step(vec.action_space.sample())
    vec.close()
