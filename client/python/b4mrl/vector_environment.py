"""A batch of environments of the daemon as a gymnasium.vector.VectorEnv."""

from __future__ import annotations

import functools
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from b4mrl import errors, infos
from b4mrl.hosted import Hosted
from b4mrl.origin import Origin
from b4mrl.states import State, read_states, write_states
from b4mrl.wire import checks
from b4mrl.wire.arrays import Array
from b4mrl.wire.lane_numbers import Lanes
from b4mrl.wire.outcomes import Ended, Outcome, StepOutcome
from b4mrl.wire.session import Session

EnvIds = ArrayLike | None
Seeds = int | Sequence[int | None] | NDArray[np.integer[Any]] | None
StepResult = tuple[Array, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class VectorEnvironment(Hosted, VectorEnv[Array, Array, Array]):
    """A batch of environments of the daemon; Client.make_vec returns it.

    Every step returns the same as Gymnasium's SyncVectorEnv over single environments with seeds s,
    s+1, ..., infos and their masks included, in each of three modes (`metadata["autoreset_mode"]`):

    - next_step: an environment's step after the end of its episode ignores the action and returns
      the new episode's first observation, reward 0 and no flag;
    - same_step: the step that ends an episode returns the new episode's first observation; the old
      episode's last observation and info are in `final_obs` and `final_info`;
    - disabled: finished environments are reset by `reset(options={"reset_mask": mask})`. Stepping
      them raises FailedPreconditionError, unless `step_past_end` was given.

    `send` and `recv` are the two halves of a step of some of the environments: several sends for
    different environments may be under way at once.

    Shapes: n environments; observations (n, *shape) in the `dtype` of Client.make_vec, rewards (n,)
    float64, flags (n,) bool. Returned arrays belong to the caller.

    Thread rule: one thread at a time. Raises the errors of b4mrl.errors. b4mrl.wire.operations says
    what Ctrl-C during a call does. pickle and copy give new environments, opened with the same
    arguments.

    Args:
        session: the environments' session; owned by this object.
        origin: the arguments with which the session was opened.

    Attributes:
        session: the session underneath; `session.in_force` has all settings and perturbations with
            their values.
        digests: (n,) uint64, a rolling hash of each environment's actions and outcomes since its
            last seeded reset; equal digests mean equal trajectories. A new array after each call.
            set_state leaves them as they were: the next step or reset tells the restored states'.
    """

    def __init__(
        self,
        session: Session,
        origin: Origin,
        step_past_end: bool = False,
        render_mode: str | None = None,
        width: int = 0,
        height: int = 0,
    ) -> None:
        super().__init__(session, origin, render_mode, width, height)
        spec = session.spec
        self._mode = AutoresetMode[session.in_force.autoreset_mode.upper()]
        self.metadata["autoreset_mode"] = self._mode
        self.num_envs = session.num_envs
        self.single_observation_space = spec.observation.box(session.dtype)
        self.single_action_space = spec.action.box(np.float32)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.digests = np.zeros(self.num_envs, np.uint64)
        self._step_past_end = step_past_end
        self._ended = np.zeros(self.num_envs, np.bool_)  # by the last step, and not reset since
        self._observations: Array = np.zeros((self.num_envs, *self._shape), session.dtype)

    def _facts(self) -> Mapping[str, Any]:
        mode = self.session.in_force.autoreset_mode
        return {"num_envs": self.num_envs, "autoreset_mode": mode, **super()._facts()}

    def reset(
        self,
        *,
        seed: Seeds = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Array, dict[str, Any]]:
        """Starts new episodes.

        Args:
            seed: a number s gives environment i the seed s + i; a sequence or an array has one
                seed for each environment, where None starts that environment's next episode; None
                starts the next episode of all.
            options: `reset_mask`, bool (n,), chooses the environments that are reset; the other
                rows of the returned observations are the latest ones. There are no other options.
        """
        chosen = self._reset_lanes({} if options is None else options)
        seed = seed.tolist() if isinstance(seed, np.ndarray) else seed
        seeds = self._seeds(seed)
        # Gymnasium's base class seeds only its `np_random`; the request below seeds the daemon.
        super().reset(seed=None if isinstance(seed, Sequence) else seeds[0])
        given = np.array([s is not None for s in seeds])[chosen]
        outcomes = []
        for lanes in (chosen[given], chosen[~given]):
            if len(lanes) == 0:
                continue
            is_seeded = seeds[lanes[0]] is not None
            values = np.array([seeds[i] for i in lanes], np.uint64) if is_seeded else None
            every = len(lanes) == self.num_envs
            outcomes.append(
                self.session.reset(None if every else lanes, values, self._begin_episodes)
            )
        rows = None
        if outcomes[0].infos is not None:
            rows = np.concatenate([outcome.infos for outcome in outcomes])
        order = np.concatenate([chosen[given], chosen[~given]])
        batch = self._infos.batch(rows, np.ones(len(order), np.bool_))
        return self._observations.copy(), infos.scatter(batch, order, self.num_envs)

    def step(self, actions: ArrayLike) -> StepResult:
        """One step of every environment; actions (n, *shape), float32 or float64.

        FailedPreconditionError: an environment was never reset, or, in mode disabled, its episode
        has ended.
        """
        rows = checks.action_rows(actions, self.num_envs, self.session.spec.action.shape)
        return self.session.step(rows, None, self._result, self._prepare_step)

    def send(self, actions: ArrayLike, env_ids: EnvIds = None) -> None:
        """Starts a step of the environments `env_ids` (k,), or of all; actions (k, *shape).

        BusyError: one of them has a step under way. LimitExceededError: 64 sends have not been
        received; beside so many, get_state and render wait until one of them is answered.
        """
        lanes = self._lanes(env_ids)
        count = self.num_envs if lanes is None else len(lanes)
        rows = checks.action_rows(actions, count, self.session.spec.action.shape)
        self.session.send_step(rows, lanes, self._part, lambda: self._prepare_step(lanes))

    def recv(self) -> StepResult:
        """The result of the first send that is answered, as `step` returns it.

        The arrays have one entry for each environment of that send, in the order of its `env_ids`;
        `info["env_id"]` (k,) names the environments. If the send failed, the raised error has the
        environments in its attribute `env_ids`. A step that got no answer within the deadline is
        still under way: call `recv` again.
        """
        return self.session.receive_step(self._part)

    def get_state(self, env_ids: EnvIds = None) -> list[State]:
        """The states of `env_ids`, or of all, as dictionaries (b4mrl.states).

        They are those behind the steps of these environments that are under way.
        """
        lanes = self._lanes(env_ids)
        found = self.session.snapshot(lanes)
        # Only now is it known how the steps that were under way have ended.
        ended = (self._ended if lanes is None else self._ended[lanes]).tolist()
        if len(found) > 1 or len(ended) == 1:
            return read_states(found, ended)
        # States of unequal sizes have their readable parts only when they travel alone.
        chosen = np.arange(self.num_envs, dtype=np.uint32) if lanes is None else lanes
        parts = [self.session.snapshot(chosen[i : i + 1]) for i in range(len(chosen))]
        return [read_states(part, [flag])[0] for part, flag in zip(parts, ended)]

    def set_state(self, states: Sequence[State], env_ids: EnvIds = None) -> Array:
        """Lets the environments `env_ids`, or all, continue from `states`, one state for each.

        Returns the states' observations (k, *shape). VersionMismatchError: a snapshot is of another
        simulator or engine version; InvalidArgumentError: of one whose lanes have another number of
        bytes. Environments whose states came before it stay restored.
        """
        lanes = self._lanes(env_ids)
        targets = np.arange(self.num_envs, dtype=np.uint32) if lanes is None else lanes
        if not isinstance(states, Sequence | np.ndarray) or getattr(states, "ndim", 1) == 0:
            raise errors.InvalidArgumentError(
                f"states are {reprlib.repr(states)}, allowed: a list of {len(targets)} states"
            )
        if len(states) != len(targets):
            raise errors.InvalidArgumentError(
                f"there are {len(states)} states, allowed: {len(targets)}, one an environment"
            )
        for restoration in write_states(states):
            chosen = targets[restoration.positions]
            keep = functools.partial(self._keep_restored, chosen, restoration.ended)
            self.session.restore(restoration.parts, chosen, keep)
        return self._observations[targets]

    def render(self) -> tuple[Array, ...] | None:
        """A picture of each environment, uint8 (height, width, 3); None without render_mode."""
        if self.render_mode is None:
            return None
        return tuple(self.session.render(*self._frame_size))

    def close_extras(self, **kwargs: Any) -> None:
        """Closes the session; called by close."""
        self.session.close()

    def __enter__(self) -> VectorEnvironment:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lanes(self, env_ids: EnvIds) -> Lanes | None:
        if env_ids is None:
            return None
        allowed = f"a list of numbers in 0..{self.num_envs - 1}"
        given = checks.array("env_ids", env_ids, allowed)
        numbers = given.ndim == 1 and np.issubdtype(given.dtype, np.integer)
        if not numbers or np.any(given < 0) or np.any(given >= self.num_envs):
            raise errors.InvalidArgumentError(f"env_ids are {env_ids!r}, allowed: {allowed}")
        return given.astype(np.uint32)

    def _reset_lanes(self, options: Mapping[str, Any]) -> Lanes:
        if not isinstance(options, Mapping) or not options.keys() <= {"reset_mask"}:
            raise errors.InvalidArgumentError(
                f"options is {options!r}, allowed: reset_mask; settings are given to make_vec as "
                "config="
            )
        mask = options.get("reset_mask")
        if mask is None:
            return np.arange(self.num_envs, dtype=np.uint32)
        allowed = f"a bool array of shape ({self.num_envs},) with at least one True"
        given = checks.array("options['reset_mask']", mask, allowed)
        if given.dtype != np.bool_ or given.shape != (self.num_envs,) or not given.any():
            raise errors.InvalidArgumentError(
                f"options['reset_mask'] is {mask!r}, allowed: {allowed}"
            )
        return np.flatnonzero(given).astype(np.uint32)

    def _seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None:
            return [None] * self.num_envs
        if not isinstance(seed, Sequence):
            first = checks.unsigned("seed", seed)
            return [checks.unsigned("seed", first + i) for i in range(self.num_envs)]
        if len(seed) != self.num_envs:
            raise errors.InvalidArgumentError(
                f"there are {len(seed)} seeds, allowed: {self.num_envs}, one an environment"
            )
        return [None if s is None else checks.unsigned("seed", s) for s in seed]

    def _prepare_step(self, lanes: Lanes | None = None) -> NDArray[np.bool_]:
        """Whether the episodes of `lanes` have ended before a step, which is refused then.

        The step's outcome is read by these flags: it may be read twice, and the first reading
        replaces `_ended`.
        """
        ended = self._ended.copy() if lanes is None else self._ended[lanes]
        is_refused = self._mode == AutoresetMode.DISABLED and not self._step_past_end
        if is_refused and ended.any():
            position = int(np.flatnonzero(ended)[0])
            lane = position if lanes is None else lanes[position]
            raise errors.FailedPreconditionError(
                f"the episode of environment {lane} has ended; reset it with "
                "options={'reset_mask': mask}, or make the environments with step_past_end=True"
            )
        return ended

    def _keep(self, outcome: Outcome, ended: bool | NDArray[np.bool_]) -> Array:
        """Keeps an outcome's observations and digests as the latest; returns the observations."""
        chosen = slice(None) if outcome.lanes is None else outcome.lanes
        observations = outcome.observations.reshape(-1, *self._shape)
        self._observations[chosen] = observations
        digests = self.digests.copy()  # the caller may have kept the earlier ones
        digests[chosen] = outcome.digests
        self.digests = digests
        self._ended[chosen] = ended
        return observations

    def _keep_restored(self, chosen: Lanes, ended: list[bool], observations: Array) -> None:
        self._observations[chosen] = observations.reshape(len(chosen), *self._shape)
        self._ended[chosen] = ended

    def _begin_episodes(self, outcome: Outcome) -> Outcome:
        self._keep(outcome, ended=False)
        return outcome

    def _part(self, outcome: StepOutcome) -> StepResult:
        observations, rewards, terminated, truncated, info = self._result(outcome)
        info["env_id"] = np.arange(self.num_envs) if outcome.lanes is None else outcome.lanes
        return observations, rewards, terminated, truncated, info

    def _result(self, outcome: StepOutcome) -> StepResult:
        rewards, terminated, truncated = outcome.rewards, outcome.terminated, outcome.truncated
        count = len(rewards)
        is_reset = np.zeros(count, np.bool_)
        info: dict[str, Any] = {}
        if self._mode == AutoresetMode.SAME_STEP:
            is_reset = outcome.prepared.copy()  # of lanes that were restored to an ended episode
            if outcome.ended is not None:
                is_reset[outcome.ended.positions] = True
                info = self._final_info(outcome, outcome.ended)
        else:
            if self._mode == AutoresetMode.NEXT_STEP:
                is_reset = outcome.prepared
            infos.add_causes(info, outcome.causes)
        info |= self._infos.batch(outcome.infos, is_reset)
        has_new_episode = self._mode == AutoresetMode.SAME_STEP
        observations = self._keep(outcome, False if has_new_episode else terminated | truncated)
        return observations, rewards, terminated, truncated, info

    def _final_info(self, outcome: StepOutcome, ended: Ended) -> dict[str, Any]:
        """`final_obs` and `final_info` of the episodes that ended in a step in mode same_step."""
        count = len(outcome.rewards)
        observations = np.full(count, None, object)
        for i, position in enumerate(ended.positions):
            observations[position] = ended.observations[i].reshape(self._shape).copy()
        final = self._infos.batch(ended.infos, np.zeros(len(ended.positions), np.bool_))
        infos.add_causes(final, outcome.causes[ended.positions])
        mask = np.zeros(count, np.bool_)
        mask[ended.positions] = True
        return {
            "final_obs": observations,
            "_final_obs": mask,
            "final_info": infos.scatter(final, ended.positions, count),
            "_final_info": mask.copy(),
        }
