"""Adapts a batch of environments to Stable-Baselines3's VecEnv. Needs stable-baselines3."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from b4mrl import errors, infos
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.wire.arrays import Array

Indices = int | Iterable[int] | None

_SPACES = ("observation_space", "action_space")  # of which the batch has its own, with an axis more


class StableBaselinesVecEnv(VecEnv):
    """A VecEnv over one session; it returns the same as DummyVecEnv over single environments.

    `dones` is true for terminated and for truncated episodes. The last observation of an episode is
    `info["terminal_observation"]`, and `info["TimeLimit.truncated"]` is true if the episode was
    truncated. There is no Python object for a single environment: attributes are those of the whole
    batch, but for its spaces, and `env_method` supports `get_state` and `set_state` only.

    Args:
        batch: made by Client.make_vec with autoreset_mode="same_step"; owned by this object.
    """

    def __init__(self, batch: VectorEnvironment) -> None:
        if not isinstance(batch, VectorEnvironment):
            raise errors.InvalidArgumentError(
                f"batch is {batch!r}, allowed: a batch of Client.make_vec(..., "
                "autoreset_mode='same_step'); an environment of Client.make needs no adapter"
            )
        if batch.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP:
            raise errors.InvalidArgumentError(
                f"autoreset_mode is {batch.metadata['autoreset_mode'].name.lower()}, "
                "allowed: same_step"
            )
        self.batch = batch
        self._actions: Any = None  # of the last step_async
        super().__init__(batch.num_envs, batch.single_observation_space, batch.single_action_space)
        self.metadata: dict[str, Any] = {**batch.metadata, **self.metadata}  # with render_fps

    def reset(self) -> Array:
        """Starts the next episodes, or the first ones of the seeds given to `seed`.

        InvalidArgumentError: `set_options` has set an option; these environments take none.
        """
        if any(self._options):
            raise errors.InvalidArgumentError(
                f"options is {self._options!r}, allowed: none; settings are given to make_vec as "
                "config="
            )
        observations, info = self.batch.reset(seed=self._seeds)
        self.reset_infos = [infos.row_of(info, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        # step_wait, which Stable-Baselines3 calls at once, sends them: after Ctrl-C in between, a
        # step that was sent and never received would keep the environments from anything else.
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[Array, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        observations, rewards, terminated, truncated, info = self.batch.step(self._actions)
        dones = terminated | truncated
        final_observations = info.pop("final_obs", None)
        rows = [infos.row_of(info, i) for i in range(self.num_envs)]
        for i in np.flatnonzero(dones):
            final = rows[i].pop("final_info")
            self.reset_infos[i] = rows[i]
            rows[i] = final | {"terminal_observation": final_observations[i]}
        for row, is_cut in zip(rows, truncated & ~terminated):
            row["TimeLimit.truncated"] = bool(is_cut)
        return observations, rewards.astype(np.float32), dones, rows

    def close(self) -> None:
        self.batch.close()

    def get_images(self) -> Sequence[Array | None]:
        return self.batch.render() or [None] * self.num_envs

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """An attribute of the batch, once for each environment; of the spaces, a single one's."""
        name = f"single_{attr_name}" if attr_name in _SPACES else attr_name
        return [getattr(self.batch, name)] * len(self._lanes(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets an attribute of the batch. UnsupportedError: `indices` names only some of it."""
        if len(self._lanes(indices)) < self.num_envs:
            raise errors.UnsupportedError(
                "indices names some environments, allowed: all, which share their attributes"
            )
        setattr(self.batch, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """`get_state()`, or `set_state(state)` with one state for all chosen environments.

        UnsupportedError: another method. InvalidArgumentError: other arguments than these.
        """
        lanes = self._lanes(indices)
        if method_name == "get_state":
            return self.batch.get_state(lanes)
        if method_name == "set_state":
            given = [*method_args, *method_kwargs.values()]
            if len(given) != 1:
                raise errors.InvalidArgumentError(
                    f"set_state has {len(given)} arguments, allowed: 1, the state"
                )
            return list(self.batch.set_state(given * len(lanes), lanes))
        raise errors.UnsupportedError(
            f"method_name is {method_name!r}, allowed: get_state, set_state"
        )

    def env_is_wrapped(self, wrapper_class: type, indices: Indices = None) -> list[bool]:
        return [False] * len(self._lanes(indices))

    def _lanes(self, indices: Indices) -> list[int]:
        return list(self._get_indices(indices))
