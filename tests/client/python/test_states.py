"""Reading and writing states."""

from __future__ import annotations

import pickle

import b4mrl
import numpy as np
import pytest
from b4mrl import errors, states

from equality import assert_same
from test_query import Tensor

RAGGED = [[1], [1, 2]]  # no array


def test_a_restored_state_continues_exactly(
    client: b4mrl.Client, environment: str, simulator: str
) -> None:
    with client.make(environment, simulator, dtype="float64") as env:
        env.action_space.seed(0)
        actions = [env.action_space.sample() for _ in range(30)]
        env.reset(seed=4)
        for action in actions[:10]:
            env.step(action)
        state = pickle.loads(pickle.dumps(env.get_state()))
        wanted = [env.step(action) for action in actions] + [env.reset()]
        observation = env.set_state(state)
        assert observation.shape == env.observation_space.shape
        assert_same([env.step(action) for action in actions] + [env.reset()], wanted)


def test_a_state_remembers_that_its_episode_has_ended(client: b4mrl.Client) -> None:
    with (
        client.make("HalfCheetah") as env,
        client.make_vec("HalfCheetah", 1, autoreset_mode="disabled") as vec,
    ):
        env.reset(seed=4)
        going_on = env.get_state()
        for _ in range(1000):
            env.step(np.zeros(6))
        vec.reset(seed=1)
        vec.set_state([env.get_state()])
        with pytest.raises(errors.FailedPreconditionError):
            vec.step(np.zeros((1, 6)))
        env.set_state(going_on)
        vec.set_state([env.get_state()])
        vec.step(np.zeros((1, 6)))


def test_an_ended_episode_that_is_restored_is_followed_by_a_reset(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env:
        env.reset(seed=4)
        for _ in range(1000):
            env.step(np.zeros(6))
        ended = env.get_state()
    for mode in ("next_step", "same_step"):
        with client.make_vec("HalfCheetah", 2, autoreset_mode=mode) as vec:
            vec.reset(seed=1)
            vec.set_state([ended], [0])
            _, rewards, terminated, truncated, info = vec.step(np.ones((2, 6)))
            assert rewards[0] == 0 and rewards[1] != 0
            assert not terminated.any() and not truncated.any()
            assert info["_reward_ctrl"].tolist() == [False, True]


def test_a_state_by_its_parts_is_that_state(client: b4mrl.Client, environment: str) -> None:
    with client.make(environment, dtype="float64") as env:
        env.action_space.seed(0)
        env.reset(seed=4)
        for _ in range(5):
            env.step(env.action_space.sample())
        state = env.get_state()
        action = env.action_space.sample()
        wanted = env.step(action)
        del state["snapshot"]
        env.reset(seed=7)
        env.set_state(state)
        assert_same(env.step(action)[:3], wanted[:3])


def test_a_changed_part_changes_the_state(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", dtype="float64") as env:
        env.reset(seed=4)
        state = env.get_state()
        state["qpos"][1] += 0.25
        height = env.get_state()["qpos"][1]
        assert env.set_state(state)[0] == height + 0.25
        assert env.get_state()["qpos"][1] == height + 0.25


def test_moving_the_humanoid_pays_no_reward(client: b4mrl.Client) -> None:
    with client.make("Humanoid", dtype="float64") as env:
        env.reset(seed=4)
        env.step(np.zeros(17))
        state = env.get_state()
        state["qpos"][0] += 5
        env.set_state(state)
        moved = env.step(np.zeros(17))[1]
        for name in ("com", "cinert", "cvel", "qfrc_actuator", "cfrc_ext"):
            del state[name]
        env.set_state(state)
        assert env.step(np.zeros(17))[1] == moved
        # Five metres would pay 1.25 * 5 / 0.015 = 417; a step at rest pays for being upright, 5.
        assert 0 < moved < 10


def test_derived_parts_count_unless_motion_changed_and_they_did_not() -> None:
    found = {
        "snapshot": np.ones((1, 5), np.uint8),
        **{
            name: np.full((1, 2), 1.0) for name in ("qpos", "qvel", "qacc_warmstart", "com", "cvel")
        },
    }

    def written(**changes: float) -> set[str]:
        (state,) = states.read_states(found, [False])
        for name, value in changes.items():
            state[name][0] = value
        (restoration,) = states.write_states([state])
        return set(restoration.parts)

    everything = set(found) - {"snapshot"}
    assert written() == {"snapshot"}
    assert written(qpos=2) == written(qvel=2) == {"qpos", "qvel", "qacc_warmstart"}
    assert written(qacc_warmstart=2) == written(com=2) == everything
    assert written(qpos=2, com=2) == everything - {"cvel"}


def test_the_warm_start_may_be_left_out(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env:
        env.reset(seed=4)
        state = env.get_state()
        env.set_state({"qpos": state["qpos"], "qvel": state["qvel"]})
        np.testing.assert_array_equal(env.get_state()["qpos"], state["qpos"])


@pytest.mark.parametrize("missing", [{"time"}, {"qacc_warmstart"}, {"time", "qpos"}])
def test_a_state_without_some_of_its_parts_continues_exactly(
    client: b4mrl.Client, missing: set[str]
) -> None:
    with client.make("HalfCheetah", "action-delay=3,obs-noise=0.1", dtype="float64") as env:
        env.reset(seed=4)
        for _ in range(5):
            env.step(np.full(6, 0.5))
        state = env.get_state()
        expected = env.step(np.ones(6))
        env.set_state({name: part for name, part in state.items() if name not in missing})
        assert_same(env.step(np.ones(6)), expected)


def test_states_go_to_the_environments_that_are_named(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 4, dtype="float64") as vec:
        vec.reset(seed=0)
        before = vec.get_state()
        mixed = [before[2], {name: before[0][name] for name in ("qpos", "qvel")}]
        observations = vec.set_state(mixed, env_ids=[1, 3])
        assert observations.shape == (2, 17)
        after = vec.get_state()
        np.testing.assert_array_equal(after[1]["qpos"], before[2]["qpos"])
        np.testing.assert_array_equal(after[3]["qpos"], before[0]["qpos"])
        for lane in (0, 2):
            assert_same(after[lane], before[lane])


@pytest.mark.parametrize(
    "state",
    [
        {},
        {"snapshot": b""},
        {"snapshot": b"x" * 100},
        {"snapshot": 7},
        {"qpos": np.zeros(9)},
        {"qpos": np.zeros(8), "qvel": np.zeros(9)},
        {"qpos": np.full(9, np.nan), "qvel": np.zeros(9)},
        {"qpos": np.zeros(9), "qvel": np.zeros(9), "speed": 1.0},
        {"qpos": "high", "qvel": np.zeros(9)},
        {"qpos": np.zeros(9, complex), "qvel": np.zeros(9)},
        {"qpos": [10**400] * 9, "qvel": np.zeros(9)},
        {"qpos": Tensor(), "qvel": np.zeros(9)},
        {"vehicles": [{"x": 1.0}]},
    ],
)
def test_a_malformed_state_is_refused_and_changes_nothing(client: b4mrl.Client, state) -> None:
    with client.make("HalfCheetah") as env:
        env.reset(seed=4)
        before = env.get_state()
        with pytest.raises(b4mrl.B4mrlError) as caught:
            env.set_state(state)
        assert not caught.value.executed_unknown
        assert_same(env.get_state(), before)


@pytest.mark.parametrize(
    ("perturbation", "kind"),
    [
        ("gravity", errors.VersionMismatchError),
        ("action-delay", errors.InvalidArgumentError),  # whose snapshots are longer
    ],
)
def test_a_snapshot_of_another_simulator_is_refused_and_its_parts_are_not(
    client: b4mrl.Client, perturbation: str, kind: type[errors.B4mrlError]
) -> None:
    with client.make("HalfCheetah") as env, client.make("HalfCheetah", perturbation) as other:
        env.reset(seed=1)
        other.reset(seed=2)
        state = env.get_state()
        with pytest.raises(
            kind, match=r"snapshot.*; remove state\['snapshot'\] to set its readable"
        ):
            other.set_state(state)
        del state["snapshot"]
        other.set_state(state)
        np.testing.assert_array_equal(other.get_state()["qpos"], state["qpos"])


def test_no_snapshot_is_to_be_removed_from_a_state_that_has_none(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env:
        env.reset(seed=1)
        with pytest.raises(errors.InvalidArgumentError) as caught:
            env.set_state({})
        assert "snapshot" in str(caught.value) and "remove" not in str(caught.value)


def test_advice_about_a_snapshot_leaves_the_error_as_it_was(
    client: b4mrl.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise errors.VersionMismatchError("snapshot of another engine", recoverable=True)

    with client.make("HalfCheetah") as env:
        env.reset(seed=1)
        state = env.get_state()
        monkeypatch.setattr(env.session._operations, "call", refuse)
        with pytest.raises(errors.VersionMismatchError, match="; remove state") as caught:
            env.set_state(state)
        assert caught.value.recoverable


def test_a_state_that_is_refused_for_another_reason_keeps_its_snapshot(
    client: b4mrl.Client,
) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset(seed=1)
        with pytest.raises(
            errors.InvalidArgumentError, match="named twice, allowed: each lane once$"
        ):
            vec.set_state(vec.get_state(), [0, 0])


def test_vehicles_are_dictionaries_that_come_back_as_they_were() -> None:
    rows = np.random.default_rng(0).normal(size=(2, 3, len(states.VEHICLE_COLUMNS)))
    whole = [states.VEHICLE_COLUMNS.index(name) for name in ("lane", "target_lane")]
    flags = [states.VEHICLE_COLUMNS.index(name) for name in ("crashed", "impact_pending")]
    rows[..., whole], rows[..., flags] = 2, [1, 0]
    found = {
        "snapshot": np.ones((2, 5), np.uint8),
        "time": np.array([[3.0], [4.0]]),
        "vehicles": rows.reshape(2, -1),
    }
    read = states.read_states(found, [False, True])
    assert read[1]["time"] == 4.0
    assert len(read[0]["vehicles"]) == 3
    assert read[0]["vehicles"][0]["lane"] == 2 and read[0]["vehicles"][0]["crashed"] is True
    (exact,) = states.write_states(read)
    assert exact.ended == [False, True]
    np.testing.assert_array_equal(exact.parts["snapshot"], found["snapshot"])
    read[0]["vehicles"][1]["speed"] = 9.0
    by_parts, exact = states.write_states(read)
    assert (by_parts.positions, exact.positions) == ([0], [1])
    assert by_parts.ended == [False]
    assert by_parts.parts["vehicles"].reshape(3, -1)[1, 3] == 9.0


@pytest.mark.parametrize("state", [None, 3, [], "abc", {1: 2}, {"\ud800": [1.0]}, np.zeros(3)])
def test_what_is_no_state_is_refused_and_changes_nothing(
    client: b4mrl.Client, state: object
) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        env.reset(seed=1)
        vec.reset(seed=1)
        before = env.get_state()
        with pytest.raises(errors.InvalidArgumentError, match="state is|name in state is"):
            env.set_state(state)
        for states in ([before, state], state):
            with pytest.raises(errors.InvalidArgumentError, match="state"):
                vec.set_state(states)
        assert env.get_state()["snapshot"] == before["snapshot"]
        assert vec.get_state()[0]["snapshot"] == before["snapshot"]


@pytest.mark.parametrize("options", [3, "abc", [1], [("reset_mask", 1)], np.zeros(3), {"speed": 1}])
def test_options_that_there_are_not_are_refused(client: b4mrl.Client, options: object) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        for reset in (env.reset, vec.reset):
            with pytest.raises(errors.InvalidArgumentError, match="options is .*config="):
                reset(options=options)


def test_lists_of_unequal_lengths_are_no_numbers_of_environments(client: b4mrl.Client) -> None:
    with client.make_vec("HalfCheetah", 2) as vec:
        vec.reset(seed=1)
        for call in (vec.get_state, lambda ids: vec.send(np.zeros((1, 6)), ids)):
            with pytest.raises(errors.InvalidArgumentError, match=r"env_ids .* allowed: .* 0\.\.1"):
                call(RAGGED)
        with pytest.raises(errors.InvalidArgumentError, match="reset_mask.*one True"):
            vec.reset(options={"reset_mask": RAGGED})


@pytest.mark.parametrize("part", ["time", "vehicles"])
def test_a_part_of_a_size_that_it_cannot_have_is_the_servers_fault(part: str) -> None:
    found = {
        "snapshot": np.zeros((1, 4), np.uint8),
        part: np.zeros((1, 0 if part == "time" else 4)),
    }
    with pytest.raises(errors.InternalError, match=part):
        states.read_states(found, [False])
