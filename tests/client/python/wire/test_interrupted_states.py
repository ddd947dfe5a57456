"""States that are read or set while a step or another call of the environment is under way."""

from __future__ import annotations

from typing import Any

import b4mrl
import numpy as np
import pytest
from b4mrl import errors

from interrupting import interrupt

AWAIT = "b4mrl.wire.connection.Connection.await_any"


@pytest.mark.parametrize("way", ["interrupted", "sent"])
def test_a_state_that_is_read_before_the_outcome_knows_that_its_episode_has_ended(
    client: b4mrl.Client, way: str
) -> None:
    options: dict[str, Any] = {"autoreset_mode": "disabled", "max_episode_steps": 1}
    with (
        client.make_vec("Hopper", 2, **options) as vec,
        client.make_vec("Hopper", 2, **options) as other,
    ):
        vec.reset(seed=1)
        other.reset(seed=2)
        actions = np.ones((2, 3))
        if way == "sent":
            vec.send(actions)
        else:
            interrupt(lambda: vec.step(actions), AWAIT, "before")
        ended = vec.get_state()
        assert [state["snapshot"][0] for state in ended] == [1, 1]
        truncated = (vec.recv() if way == "sent" else vec.step(actions))[3]
        assert truncated.all()  # the outcome is still there
        other.set_state(ended)
        with pytest.raises(errors.FailedPreconditionError, match="has ended"):
            other.step(actions)


def test_so_does_the_state_of_a_single_environment_and_one_that_an_interrupted_call_has_set(
    client: b4mrl.Client,
) -> None:
    with client.make("Hopper", max_episode_steps=1) as env, client.make_vec("Hopper", 2) as vec:
        env.reset(seed=1)
        going_on = env.get_state()
        interrupt(lambda: env.step(np.ones(3)), AWAIT, "before")
        ended = env.get_state()
        assert ended["snapshot"][0] == 1
        assert env.step(np.ones(3))[3]
        interrupt(lambda: env.set_state(going_on), AWAIT, "before")
        assert env.get_state()["snapshot"][0] == 0
        vec.reset(seed=1)
        both = vec.get_state()
        for state in both:
            state["snapshot"] = b"\1" + state["snapshot"][1:]
        interrupt(lambda: vec.set_state(both), AWAIT, "before")
        assert [state["snapshot"][0] for state in vec.get_state()] == [1, 1]
