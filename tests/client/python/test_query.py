"""Queries: one simulated step from arbitrary observations and actions."""

from __future__ import annotations

import b4mrl
import numpy as np
import pytest
from b4mrl import errors, query
from b4mrl.wire import limits


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
        for numbers in ({}, {"seed": 1}, {"draw": 1}, {"first_row": 1})
    ]
    for other in draws[1:]:
        assert np.all(draws[0] != other)
    # Row 1 of a query from row 0 has the noise of row 0 of a query from row 1.
    shifted = client.query(
        "HalfCheetah", observations[1:], actions[1:], "obs-noise=0.1", first_row=1
    )[0]
    np.testing.assert_array_equal(draws[0][1:], shifted)


def test_float32_rows_are_answered_in_float32(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 10)
    wide = client.query("HalfCheetah", observations.astype(np.float32), actions)
    assert wide[0].dtype == np.float32


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


def test_a_query_session_that_was_lost_is_opened_again(client: b4mrl.Client) -> None:
    observations, actions = rows(client, "HalfCheetah", 3)
    wanted = client.query("HalfCheetah", observations, actions)
    (session,) = client._query_sessions.values()
    session._connection.call(close_request(), bytearray(), 5000)
    for a, b in zip(client.query("HalfCheetah", observations, actions), wanted):
        np.testing.assert_array_equal(a, b)


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
