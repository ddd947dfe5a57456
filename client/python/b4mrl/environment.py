"""One environment of the daemon as a gymnasium.Env."""

from __future__ import annotations

import functools
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from b4mrl import infos
from b4mrl.errors import InvalidArgumentError
from b4mrl.hosted import Hosted
from b4mrl.origin import Origin
from b4mrl.states import State, read_states, write_states
from b4mrl.wire import checks
from b4mrl.wire.arrays import Array
from b4mrl.wire.outcomes import LaneStep, Outcome
from b4mrl.wire.session import Session


class Environment(Hosted, gym.Env[Array, Array]):
    """One environment of the daemon; Client.make returns it.

    Observations are arrays of the observation space's shape, in the `dtype` of Client.make. Actions
    may be float32 or float64; the task's own rule treats values outside the action space. As with
    Gymnasium's own tasks, an environment whose episode has ended may be stepped on. `info` has the
    numbers of the original task's info and, when the episode ended, `cause`: "unhealthy", "limit",
    "crash" or "numerical_error".

    Thread rule: one thread at a time. Raises the errors of b4mrl.errors. b4mrl.wire.operations says
    what Ctrl-C during a call does. pickle and copy give a new environment, opened with the same
    arguments.

    Args:
        session: a session of one lane; owned by the environment.
        origin: the arguments with which the session was opened.

    Attributes:
        session: the session underneath; `session.in_force` has all settings and perturbations with
            their values.
        digest: rolling hash of the actions and outcomes since the last seeded reset; equal digests
            mean equal trajectories. set_state leaves it as it was: the next step or reset tells the
            restored state's.
    """

    def __init__(
        self,
        session: Session,
        origin: Origin,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
    ) -> None:
        super().__init__(session, origin, render_mode, width, height)
        self.digest = 0
        self._has_ended = False  # the episode
        self.observation_space: spaces.Box = session.spec.observation.box(session.dtype)
        self.action_space: spaces.Box = session.spec.action.box(np.float32)

    @property
    def unwrapped(self) -> Environment:
        """This object, under all wrappers of gym.make and of the caller."""
        return self

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts the next episode, or with `seed` the first one of that seed.

        InvalidArgumentError: `options` is neither None nor empty.
        """
        if options is not None and (not isinstance(options, dict) or options):
            raise InvalidArgumentError(
                f"options is {options!r}, allowed: none; settings are given to make as config="
            )
        number = None if seed is None else checks.unsigned("seed", seed)
        # Gymnasium's base class seeds only its `np_random`; the request below seeds the daemon.
        super().reset(seed=number)
        seeds = None if number is None else np.array([number], np.uint64)
        return self.session.reset(None, seeds, self._begin_episode)

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """One step. FailedPreconditionError: the environment was never reset."""
        rows = checks.action_row(action, self.session.spec.action.shape)
        return self.session.step_lane(rows, self._result)

    def get_state(self) -> State:
        """The state as a dictionary (b4mrl.states)."""
        found = self.session.snapshot()
        # Only now is it known how an interrupted step has ended.
        return read_states(found, [self._has_ended])[0]

    def set_state(self, state: State) -> Array:
        """Lets the environment continue from `state`; returns the state's observation.

        VersionMismatchError: the state's snapshot is of another simulator or engine version.
        InvalidArgumentError: it is of one whose lanes have another number of bytes.
        """
        (restoration,) = write_states([state])
        (has_ended,) = restoration.ended
        keep = functools.partial(self._keep_restored, has_ended)
        return self.session.restore(restoration.parts, None, keep)

    def render(self) -> Array | None:
        """A picture of the current state, uint8 (height, width, 3); None without render_mode."""
        if self.render_mode is None:
            return None
        return self.session.render(*self._frame_size)[0]

    def close(self) -> None:
        """Closes the session. May be called again."""
        self.session.close()

    def _keep_restored(self, has_ended: bool, observations: Array) -> Array:
        self._has_ended = has_ended
        observation: Array = observations[0]
        return observation.reshape(self._shape)

    def _begin_episode(self, outcome: Outcome) -> tuple[Array, dict[str, Any]]:
        self._has_ended = False
        self.digest = int(outcome.digests[0])
        observation: Array = outcome.observations[0]
        row = None if outcome.infos is None else outcome.infos[0].tolist()
        return observation.reshape(self._shape), self._infos.single(row, is_reset=True)

    def _result(self, step: LaneStep) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        self.digest = step.digest
        self._has_ended = step.terminated or step.truncated
        info = self._infos.single(step.infos, is_reset=False)
        if step.cause:
            info["cause"] = infos.cause_name(step.cause)
        observation = step.observation
        if len(self._shape) != 1:
            observation = observation.reshape(self._shape)
        return observation, step.reward, step.terminated, step.truncated, info
