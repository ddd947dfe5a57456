"""Single environments: Gymnasium's own checker, and what goes beyond it."""

from __future__ import annotations

import typing
import warnings
from dataclasses import replace

import b4mrl
import gymnasium as gym
import numpy as np
import pytest
from b4mrl import errors
from gymnasium.utils.env_checker import check_env

from equality import assert_same


def walk(env: gym.Env, steps: int, seed: int = 0) -> list:
    """Random steps, with a reset after each end."""
    env.action_space.seed(seed)
    results = []
    for _ in range(steps):
        results.append(env.step(env.action_space.sample()))
        if results[-1][2] or results[-1][3]:
            results.append(env.reset())
    return results


# What Gymnasium's own tasks are warned of too: infinite bounds and actions beyond [-1, 1].
KNOWN_WARNINGS = ("minimum value is -infinity", "maximum value is infinity", "symmetric and norm")


def test_gymnasiums_checker_passes(client: b4mrl.Client, environment: str, simulator: str) -> None:
    env = client.make(environment, simulator)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    # Sockets of other tests may be collected meanwhile, which is no matter of this one.
    surprises = [str(w.message) for w in caught if w.category is not ResourceWarning]
    surprises = [text for text in surprises if not any(known in text for known in KNOWN_WARNINGS)]
    assert surprises == []


def test_a_range_draws_a_number_for_each_episode_and_info_has_it(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", "gravity=0.5..2", seed=3) as env:
        drawn = set()
        for _ in range(4):
            _, info = env.reset()
            *_, step_info = env.step(env.action_space.sample())
            assert 0.5 <= info["gravity"] <= 2 and step_info["gravity"] == info["gravity"]
            drawn.add(info["gravity"])
        assert len(drawn) == 4
        # The same seed starts the same episodes again.
        _, info = env.reset(seed=3)
        assert info["gravity"] in drawn


def test_a_registered_environment_passes_as_well(endpoint: str, environment: str) -> None:
    name = f"b4mrl:b4mrl/{environment}-v0"
    with gym.make(name, endpoint=endpoint, simulator="obs-noise=0.01") as env:
        assert env.unwrapped.session.in_force.perturbations[0].name == "obs-noise"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            check_env(env.unwrapped, skip_render_check=True)


def test_equal_seeds_give_equal_numbers_and_others_do_not(
    client: b4mrl.Client, environment: str
) -> None:
    walks = {}
    for name, seed in [("a", 5), ("b", 5), ("c", 6)]:
        with client.make(environment, "obs-noise=0.1", seed=999) as env:
            walks[name] = [env.reset(seed=seed), *walk(env, 50)], env.digest
    assert_same(walks["a"], walks["b"])
    assert walks["a"][1] != walks["c"][1]


def test_the_seed_of_make_holds_until_a_reset_has_one(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", seed=5) as made, client.make("HalfCheetah", seed=6) as reset:
        assert_same(made.reset(), reset.reset(seed=5))
        assert_same(made.reset(), reset.reset())  # the next episode


def test_float64_observations_round_to_the_float32_ones(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", dtype="float64") as wide, client.make("HalfCheetah") as narrow:
        assert wide.observation_space.dtype == np.float64
        a, b = wide.reset(seed=1)[0], narrow.reset(seed=1)[0]
        np.testing.assert_array_equal(a.astype(np.float32), b)
        action = np.linspace(-1, 1, 6)
        rounded = action.astype(np.float32)
        # Actions keep their own precision, whatever that of the observations is.
        one, other = wide.step(action), wide.step(rounded.astype(np.float64))
        assert one[1] != other[1]
        np.testing.assert_array_equal(narrow.step(rounded)[0].dtype, np.float32)


def test_an_environment_that_has_ended_may_be_stepped_on(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah", config={"max_episode_steps": 30}) as env:
        env.reset(seed=0)
        limit = env.session.spec.max_episode_steps
        flags = [env.step(np.zeros(6))[2:] for _ in range(limit + 3)]
    assert limit == 30
    assert [truncated for _, truncated, _ in flags] == [False] * (limit - 1) + [True] * 4
    assert flags[limit - 1][2]["cause"] == "limit"


def test_a_step_before_the_first_reset_is_refused(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env, pytest.raises(errors.FailedPreconditionError):
        env.step(np.zeros(6))


@pytest.mark.parametrize(
    "action", [np.zeros(5), np.zeros((1, 6)), 0.0, [np.nan] * 6, ["a"] * 6, [np.inf] * 6]
)
def test_a_malformed_action_is_refused_and_changes_nothing(client: b4mrl.Client, action) -> None:
    with client.make("HalfCheetah") as env, client.make("HalfCheetah") as twin:
        env.reset(seed=3)
        twin.reset(seed=3)
        with pytest.raises(errors.InvalidArgumentError):
            env.step(action)
        assert_same(env.step(np.ones(6)), twin.step(np.ones(6)))


@pytest.mark.parametrize("seed", [-1, 2**64, 0.5, "1"])
def test_a_seed_that_cannot_be_is_refused(client: b4mrl.Client, seed: object) -> None:
    with client.make("HalfCheetah") as env, client.make_vec("HalfCheetah", 2) as vec:
        with pytest.raises(errors.InvalidArgumentError, match="seed"):
            env.reset(seed=seed)
        with pytest.raises(errors.InvalidArgumentError, match="seed"):
            vec.reset(seed=[seed, 1])
        with pytest.raises(errors.InvalidArgumentError, match="seed"):
            vec.reset(seed=seed)
        env.reset(seed=np.int64(3))
        vec.reset(seed=np.int64(3))


def test_a_list_is_an_action(client: b4mrl.Client) -> None:
    with client.make("HalfCheetah") as env, client.make("HalfCheetah") as twin:
        env.reset(seed=3)
        twin.reset(seed=3)
        for action in ([1, 0, 0, 0, 0, 0], [0.5] * 6):
            assert_same(env.step(action), twin.step(np.array(action, np.float64)))


@pytest.mark.parametrize(
    ("action", "complaint"),
    [
        (np.zeros(3), "action has shape (3,)"),
        (np.zeros((1, 6)), "action has shape (1, 6)"),
        (None, "action is None"),  # which numpy takes as a number without a value
        (2, "action is 2"),
    ],
)
def test_a_wrong_action_is_named_as_it_was_given(client: b4mrl.Client, action, complaint) -> None:
    with client.make("HalfCheetah") as env:
        env.reset()
        with pytest.raises(errors.InvalidArgumentError) as caught:
            env.step(action)
        assert str(caught.value) == f"{complaint}, allowed: numbers of shape (6,)"


class Tensor:
    """One of PyTorch's that cannot be converted as it is."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("use tensor.detach().numpy() instead")

    def __repr__(self) -> str:
        return "tensor"


@pytest.mark.parametrize(
    ("action", "complaint", "reason"),
    [
        ("left", "action is 'left'", "could not convert string to float"),
        ([[1, 2], [3]], "action is [[1, 2], [3]]", "setting an array element with a sequence"),
        (["a"] * 6, "action is ['a', 'a', 'a', 'a', 'a', 'a']", "could not convert string"),
        (Tensor(), "action is tensor", "use tensor.detach().numpy() instead"),
    ],
)
def test_an_action_that_is_no_array_is_refused_with_the_reason(
    client: b4mrl.Client, action, complaint, reason
) -> None:
    with client.make("HalfCheetah") as env:
        env.reset()
        with pytest.raises(errors.InvalidArgumentError) as caught:
            env.step(action)
        assert str(caught.value).startswith(f"{complaint}, allowed: numbers of shape (6,) (")
        assert reason in str(caught.value)
        assert caught.value.__cause__ is not None


def test_what_was_wrong_about_a_number_is_told(client: b4mrl.Client) -> None:
    for value in (1.0, -1, 2**64):
        with pytest.raises(errors.InvalidArgumentError) as caught:
            client.make("HalfCheetah", seed=value)
        wanted = f"seed is {value}, allowed: an integer in 0..18446744073709551615"
        assert str(caught.value) == wanted


@pytest.mark.parametrize("deadline", [0, -5, "10", float("nan"), float("inf"), True])
def test_a_deadline_that_cannot_be_is_refused(client: b4mrl.Client, deadline: object) -> None:
    for call in (b4mrl.connect, client.make, client.make_vec):
        target = client.endpoint if call == b4mrl.connect else "HalfCheetah"
        with pytest.raises(errors.InvalidArgumentError, match="deadline_ms is"):
            call(target, deadline_ms=deadline)


@pytest.mark.parametrize(
    ("arguments", "kind"),
    [
        ({"environment": "HalfCheeta"}, errors.UnknownNameError),
        ({"environment": None}, errors.InvalidArgumentError),
        ({"environment": "Half\ud800"}, errors.InvalidArgumentError),  # half a character
        ({"simulator": "gravty"}, errors.UnknownNameError),
        ({"simulator": "gravity=heavy"}, errors.InvalidArgumentError),
        ({"simulator": "gravity,,friction"}, errors.InvalidArgumentError),
        ({"simulator": "gravity="}, errors.InvalidArgumentError),
        ({"config": {"no_such_setting": 1}}, errors.UnknownNameError),
        ({"config": {"x": object()}}, errors.InvalidArgumentError),
        ({"config": 3}, errors.InvalidArgumentError),
        ({"config": {"x": float("nan")}}, errors.InvalidArgumentError),
        ({"dtype": "float16"}, errors.InvalidArgumentError),
        ({"dtype": "no such"}, errors.InvalidArgumentError),
        ({"dtype": None}, errors.InvalidArgumentError),
        ({"max_episode_steps": 0}, errors.InvalidArgumentError),
        ({"seed": -1}, errors.InvalidArgumentError),
        ({"seed": 2**64}, errors.InvalidArgumentError),
        ({"render_mode": "human"}, errors.InvalidArgumentError),
    ],
)
def test_what_cannot_be_made_is_refused_by_name(client: b4mrl.Client, arguments, kind) -> None:
    with pytest.raises(kind) as caught:
        client.make(**({"environment": "HalfCheetah"} | arguments))
    assert isinstance(caught.value, b4mrl.B4mrlError)
    assert len(str(caught.value)) > 10


def test_closing_twice_is_allowed_and_any_call_then_says_so(client: b4mrl.Client) -> None:
    env = client.make("HalfCheetah", render_mode="rgb_array")
    env.reset()
    state = env.get_state()
    env.close()
    env.close()
    vec = client.make_vec("HalfCheetah")
    vec.reset()
    vec.send(np.zeros((1, 6)))
    vec.close()
    calls = [env.reset, env.render, env.get_state, vec.recv, vec.get_state]
    for call in [*calls, lambda: env.step(np.zeros(6)), lambda: env.set_state(state)]:
        with pytest.raises(errors.FailedPreconditionError, match="^the environment is closed$"):
            call()


def test_closing_gives_the_session_back(client: b4mrl.Client) -> None:
    before = client.server_status().session_count
    env = client.make("HalfCheetah")
    assert client.server_status().session_count == before + 1
    env.close()
    assert client.server_status().session_count == before


def test_a_specification_names_every_dimension(client: b4mrl.Client, environment: str) -> None:
    spec = client.environments()[environment]
    for space in (spec.observation, spec.action):
        assert len(set(space.names)) == space.size == len(space.units) == len(space.low)
        assert np.prod(space.shape) == space.size
    assert spec.reward and spec.step_seconds > 0


def test_the_normalised_score_maps_its_references_to_0_and_100(client: b4mrl.Client) -> None:
    spec = client.environments()["HalfCheetah"]
    assert spec.normalised_score(spec.reference_min) == 0
    assert spec.normalised_score(spec.reference_max) == 100


def test_specs_are_equal_if_all_their_numbers_are(client: b4mrl.Client, environment: str) -> None:
    one, two = (client.environments()[environment] for _ in range(2))
    assert one is not two and one == two and len({one, two}) == 1
    other = replace(one.observation, low=np.full_like(one.observation.low, -7.0))
    assert one.observation == two.observation != other
    assert replace(one, observation=other) != two
    assert one != environment


def test_every_spec_for_gymnasium_becomes_json(client: b4mrl.Client) -> None:
    modes = {"dtype": np.float64, "autoreset_mode": gym.vector.AutoresetMode.SAME_STEP}
    with client.make("HalfCheetah", dtype=np.float64) as env:
        assert gym.envs.registration.EnvSpec.from_json(env.spec.to_json()) == env.spec
    with client.make_vec("HalfCheetah", 2, **modes) as vec:
        assert gym.envs.registration.EnvSpec.from_json(vec.spec.to_json()) == vec.spec


def test_type_checkers_know_what_is_under_the_wrappers() -> None:
    """So that `env.unwrapped.normalised_score(total)` passes them."""
    hints = typing.get_type_hints(b4mrl.Environment.unwrapped.fget)
    assert hints["return"] is b4mrl.Environment


def test_a_flag_of_the_infos_is_a_bool(client: b4mrl.Client) -> None:
    crashed: list[object] = []
    with client.make("Highway") as env, client.make_vec("Highway", 2) as vec:
        crashed += [env.reset(seed=1)[1]["crashed"], env.step([1, 0])[4]["crashed"]]
        vec.reset(seed=1)
        batches = [vec.step(np.tile([1.0, 0.0], (2, 1)))[4]["crashed"] for _ in range(60)]
        assert {batch.dtype for batch in batches} == {np.dtype(bool)}
        assert np.any(batches)
    assert crashed == [False, False] and {type(each) for each in crashed} == {bool}


@pytest.mark.parametrize("options", [{"config": {"vehicles_count": 15}}, {"speed": 1}])
def test_options_of_a_reset_are_refused_and_change_nothing(
    client: b4mrl.Client, options: dict[str, object]
) -> None:
    with client.make("Highway") as env:
        env.reset(seed=3)
        before = env.get_state()
        with pytest.raises(errors.InvalidArgumentError, match="options"):
            env.reset(options=options)
        assert_same(env.get_state(), before)
        env.reset(options={})
