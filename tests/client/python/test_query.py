"""Queries: one simulated step from arbitrary observations and actions."""

from __future__ import annotations

import b4mrl
import numpy as np
import pytest
from b4mrl import errors, query
from b4mrl.wire import limits

from conftest import in_a_child
from equality import assert_same


def rows(client: b4mrl.Client, environment: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Observations that occur, and random actions."""
    with client.make_vec(environment, 64, dtype="float64") as vec:
        parts = [vec.reset(seed=1)[0]]
        actions = [vec.action_space.sample()]
        while 64 * len(parts) < count:
            parts.append(vec.step(actions[-1])[0])
            actions.append(vec.action_space.sample())
    return np.concatenate(parts)[:count], np.concatenate(actions)[:count]


def test_a_long_query_may_be_cut_anywhere(client: b4mrl.Client, environment: str) -> None:
    observations, actions = rows(client, environment, 5_000)
    options = {"simulator": "obs-noise=0.1", "seed": 3, "draw": 2}
    whole = client.query(environment, observations, actions, **options)
    cut = 321  # and requests hold 4,096 rows
    first = client.query(environment, observations[:cut], actions[:cut], **options)
    second = client.query(environment, observations[cut:], actions[cut:], first_row=cut, **options)
    assert whole[0].shape == observations.shape and whole[0].dtype == np.float64
    assert [column.dtype for column in whole[1:]] == [np.float64, np.bool_, np.bool_]
    assert whole[3].mean() > 0.99
    for column, a, b in zip(whole, first, second):
        np.testing.assert_array_equal(column, np.concatenate([a, b]))


def test_another_seed_or_draw_gives_other_noise(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 10)
    draws = [
        client.query("HalfCheetah", observations, actions, "obs-noise=0.1", **numbers)[0]
        for numbers in (
            {"draw": 0},
            {"draw": 0, "seed": 1},
            {"draw": 1},
            {"draw": 0, "first_row": 1},
        )
    ]
    for other in draws[1:]:
        assert np.all(draws[0] != other)
    # Row 1 of a query from row 0 has the noise of row 0 of a query from row 1.
    shifted = client.query(
        "HalfCheetah", observations[1:], actions[1:], "obs-noise=0.1", draw=0, first_row=1
    )[0]
    np.testing.assert_array_equal(draws[0][1:], shifted)


def test_a_refused_query_takes_no_draw(client: b4mrl.Client) -> None:
    given = rows(client, "HalfCheetah", 2)
    noise = "obs-noise=0.1234"  # of no other query
    first = client.query("HalfCheetah", *given, noise)[0]
    for wrong in ((given[0][:, 1:], given[1]), (given[0], given[1][:1])):
        with pytest.raises(errors.InvalidArgumentError):
            client.query("HalfCheetah", *wrong, noise)
    second = client.query("HalfCheetah", *given, noise)[0]
    assert_same(first, client.query("HalfCheetah", *given, noise, draw=0)[0])
    assert_same(second, client.query("HalfCheetah", *given, noise, draw=1)[0])


def test_queries_without_a_draw_have_the_next_one_of_their_simulator(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    noisy, noisier = ((observations, actions, f"obs-noise={level}") for level in (0.1, 0.2))
    answers = [
        client.query("HalfCheetah", *noisy)[0],
        client.query_async("HalfCheetah", *noisy).result()[0],
        client.query("HalfCheetah", *noisy, draw=0)[0],
    ]
    # The same simulator in the other dtype goes on; another simulator begins.
    client.query("HalfCheetah", observations.astype(np.float32), actions, "obs-noise=0.1")
    answers += [
        client.query("HalfCheetah", *noisy)[0],
        client.query("HalfCheetah", *noisier)[0],
    ]
    wanted = [client.query("HalfCheetah", *noisy, draw=draw)[0] for draw in (0, 1, 0, 3)]
    wanted.append(client.query("HalfCheetah", *noisier, draw=0)[0])
    assert_same(answers, wanted)
    assert np.all(answers[0] != answers[1])


def test_a_forked_child_does_not_repeat_the_noise_of_its_parent(client: b4mrl.Client) -> None:
    given = *rows(client, "HalfCheetah", 3), "obs-noise=0.1"
    for _ in range(2):
        client.query("HalfCheetah", *given)
    wanted = [client.query("HalfCheetah", *given, draw=draw) for draw in (2, 3)]
    found = in_a_child(lambda: [client.query("HalfCheetah", *given) for _ in range(2)])
    assert_same(found, wanted)
    assert_same([client.query("HalfCheetah", *given) for _ in range(2)], wanted)


def test_float32_rows_are_answered_in_float32(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 10)
    wide = client.query("HalfCheetah", observations.astype(np.float32), actions)
    assert wide[0].dtype == np.float32


def test_each_array_keeps_its_own_precision(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 10)
    observations = observations.astype(np.float32)
    actions = actions.astype(np.float64) + 1e-12  # no float32 numbers
    narrow = client.query("HalfCheetah", observations, actions)
    wide = client.query("HalfCheetah", observations.astype(np.float64), actions)
    assert narrow[0].dtype == np.float32
    np.testing.assert_array_equal(narrow[1], wide[1])  # the reward counts the action's square
    assert np.any(wide[1] != client.query("HalfCheetah", observations, np.float32(actions))[1])
    for other in (">f8", np.longdouble):
        again = client.query("HalfCheetah", np.array(observations, other), np.array(actions, other))
        assert_same(again, wide)


def test_a_row_that_is_not_finite_is_not_valid(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    observations[1, 4] = np.nan
    next_observations, rewards, _, valid = client.query("HalfCheetah", observations, actions)
    assert valid.tolist() == [True, False, True]
    assert not next_observations[1].any() and rewards[1] == 0


def test_no_rows_give_no_rows(client: b4mrl.Client) -> None:
    answer = client.query("HalfCheetah", np.zeros((0, 17)), np.zeros((0, 6)))
    assert [column.shape for column in answer] == [(0, 17), (0,), (0,), (0,)]


@pytest.mark.parametrize(
    ("observations", "actions"),
    [((3, 17), (2, 6)), ((3, 16), (3, 6)), ((3, 17), (3, 5)), ((17,), (6,))],
)
def test_rows_that_do_not_fit_are_refused(client: b4mrl.Client, observations, actions) -> None:
    with pytest.raises(errors.InvalidArgumentError):
        client.query("HalfCheetah", np.zeros(observations), np.zeros(actions))


class Tensor:
    """As PyTorch's that requires grad."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("Use tensor.detach().numpy() instead.")


@pytest.mark.parametrize(
    "rows",
    [
        [[1.0, 2.0], [3.0]],
        [["far"] * 17],
        None,
        Tensor(),
        [[10**400] * 17],
        np.zeros((2, 17), "c8"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused(client: b4mrl.Client, rows: object) -> None:
    for observations, actions in ((rows, np.zeros((2, 6))), (np.zeros((2, 17)), rows)):
        with pytest.raises(errors.InvalidArgumentError):
            client.query("HalfCheetah", observations, actions)


def test_the_caller_may_change_the_rows_of_a_query_under_way(client: b4mrl.Client) -> None:
    observations, actions = np.full((4, 17), 0.1), np.full((4, 6), 0.5)
    wanted = client.query("HalfCheetah", observations, actions)
    pending = client.query_async("HalfCheetah", observations, actions)
    observations[:], actions[:] = 0, 0
    assert_same(pending.result(), wanted)


def test_a_query_session_that_was_lost_is_opened_again(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    wanted = client.query("HalfCheetah", observations, actions)
    (session,) = client._query_sessions._sessions.values()
    session._connection.call(close_request(), bytearray(), 5000)
    for a, b in zip(client.query("HalfCheetah", observations, actions), wanted):
        np.testing.assert_array_equal(a, b)


def test_queries_under_way_are_answered_as_if_asked_one_by_one(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 10_000)  # longer than what is sent at once
    simulators = ("obs-noise=0.1", "gravity", "obs-noise=0.1")
    under_way = [
        client.query_async("HalfCheetah", observations, actions, simulator, draw=i)
        for i, simulator in enumerate(simulators)
    ]
    given = observations.copy(), actions.copy()
    observations[:], actions[:] = 0, 0  # a caller may use its arrays again
    for i, (simulator, pending) in reversed(list(enumerate(zip(simulators, under_way)))):
        wanted = client.query("HalfCheetah", *given, simulator, draw=i)
        for a, b in zip(pending.result(), wanted):
            np.testing.assert_array_equal(a, b)
        assert pending.result() is pending.result()


def test_a_closed_client_says_so_of_a_query_under_way(endpoint: str) -> None:
    client = b4mrl.connect(endpoint)
    query = client.query_async("HalfCheetah", np.zeros((2, 17)), np.zeros((2, 6)))
    client.close()
    with pytest.raises(errors.FailedPreconditionError, match="^the connection is closed"):
        query.result()


def test_a_closed_client_opens_no_session_for_a_query(endpoint: str) -> None:
    client = b4mrl.connect(endpoint)
    client.close()
    with pytest.raises(errors.FailedPreconditionError, match="^the connection is closed"):
        client.query("HalfCheetah", np.zeros((2, 17)), np.zeros((2, 6)))
    assert not client._query_sessions._sessions


def test_queries_whose_answers_nobody_wants_are_dropped(client: b4mrl.Client) -> None:
    observations, actions = np.zeros((6 * 1024, 17)), np.zeros((6 * 1024, 6))
    under_way = [client.query_async("HalfCheetah", observations, actions) for _ in range(10)]
    with pytest.raises(errors.LimitExceededError):
        client.query_async("HalfCheetah", observations, actions)
    (session,) = client._query_sessions._sessions.values()
    assert len(session._connection._pending) == 10 * 6
    del under_way
    assert not session._connection._pending


def test_a_query_under_way_outlives_the_room_for_its_session(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    pending = client.query_async("HalfCheetah", observations, actions, "gravity=0.5")
    for i in range(20):
        client.query("HalfCheetah", observations, actions, f"gravity={1 + i / 20}")
    wanted = client.query("HalfCheetah", observations, actions, "gravity=0.5")
    np.testing.assert_array_equal(pending.result()[0], wanted[0])


def test_a_query_under_way_whose_session_was_lost_is_asked_again(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    wanted = client.query("HalfCheetah", observations, actions)
    (session,) = client._query_sessions._sessions.values()
    session._connection.call(close_request(), bytearray(), 5000)
    pending = [client.query_async("HalfCheetah", observations, actions) for _ in range(2)]
    for each in pending:
        np.testing.assert_array_equal(each.result()[0], wanted[0])


def close_request():
    from b4mrl.wire.messages import Request

    request = Request()
    request.close.SetInParent()
    return request


def test_a_request_and_its_reply_fit_a_message_however_wide_the_rows_are() -> None:
    wide = query.Rows(np.zeros((1, limits.MAX_OBSERVATION_DIMENSIONS)), np.zeros((1, 1024)))
    assert 0 < query._rows_at_once(wide) * (4096 + 1024) * 8 < limits.MAX_PAYLOAD_BYTES
    narrow = query.Rows(np.zeros((1, 17), np.float32), np.zeros((1, 6), np.float32))
    assert query._rows_at_once(narrow) == query._ROWS_AT_ONCE
