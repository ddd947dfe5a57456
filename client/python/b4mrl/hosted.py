"""The common base of single environments and batches of environments."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import Any, overload

import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from b4mrl import config, errors, infos, simulators
from b4mrl.display import Shown
from b4mrl.origin import Origin
from b4mrl.wire import checks, limits
from b4mrl.wire.session import Session

RENDER_MODES = ("rgb_array",)


def shown(render_mode: str | None, width: int, height: int) -> dict[str, Any]:
    """The arguments by name. InvalidArgumentError: there is no such render mode or size."""
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise errors.InvalidArgumentError(
            f"render_mode is {render_mode!r}, allowed: None, {', '.join(RENDER_MODES)}"
        )
    sizes = {"width": _side("width", width), "height": _side("height", height)}
    return {"render_mode": render_mode, **sizes}


def _side(name: str, value: int) -> int:
    try:
        pixels = checks.unsigned(name, value, bits=32)
    except errors.InvalidArgumentError:
        pixels = -1
    if pixels != 0 and not limits.MIN_PICTURE_SIDE <= pixels <= limits.MAX_PICTURE_SIDE:
        raise errors.InvalidArgumentError(
            f"{name} is {value!r}, allowed: {limits.MIN_PICTURE_SIDE}..{limits.MAX_PICTURE_SIDE} "
            "pixels, or 0 for the environment's default"
        )
    return pixels


class Hosted(Shown):
    """A session of the daemon that appears as a Gymnasium environment.

    Base of Environment and VectorEnvironment, before Gymnasium's own class. pickle and copy give a
    new environment, opened with the same arguments.

    Args:
        session: owned by this object.
        origin: the arguments with which the session was opened.
        render_mode, width, height: as in Client.make, which has checked them.
    """

    def __init__(
        self, session: Session, origin: Origin, render_mode: str | None, width: int, height: int
    ) -> None:
        spec = session.spec
        self.session = session
        self._origin = origin
        self.spec = origin.gym_spec()
        self.metadata: dict[str, Any] = {
            "render_modes": list(RENDER_MODES),
            "render_fps": max(round(1 / spec.step_seconds), 1),  # frames per simulated second
        }
        self.render_mode = render_mode
        self._frame_size = width, height
        self._infos = infos.InfoLayout(spec.info_names, spec.reset_info_names)

    def __reduce__(self) -> tuple[Any, ...]:
        return (self._origin.open_again, ())

    def _facts(self) -> Mapping[str, Any]:
        spec = self.session.spec
        return {
            "environment": self.environment,
            "simulator": self.simulator,
            "observation": f"{spec.observation.shape} {self.session.dtype}",
            "action": f"{spec.action.shape} float32",
            "max_episode_steps": spec.max_episode_steps,
        }

    @property
    def spec(self) -> EnvSpec | None:
        """The spec from which gym.make or gym.make_vec makes the same environment again.

        Its `max_episode_steps` is the daemon's limit, None without one, and its arguments are what
        was opened, as JSON has it, whatever spec was assigned.
        """
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None:
            self._spec.max_episode_steps = self.session.spec.max_episode_steps or None
            opened = self._origin.gym_spec().kwargs
            given = self._spec.kwargs.items()
            self._spec.kwargs = {name: opened.get(name, value) for name, value in given}
            is_lifted = opened.get("max_episode_steps") == config.WITHOUT_LIMIT
            if is_lifted and self._spec.max_episode_steps is None:
                # gym.make takes None for the task's own limit, which this argument lifts.
                self._spec.kwargs["max_episode_steps"] = config.WITHOUT_LIMIT

    @property
    def environment(self) -> str:
        """The environment's name, as in Client.make."""
        return self.session.spec.name

    @property
    def simulator(self) -> str:
        """The perturbations in parametric form, "gravity=2"; "" for the true environment."""
        return simulators.text_of(self.session.in_force.perturbations)

    @property
    def transport(self) -> str:
        """How messages travel to the daemon: "door", "ipc", "tcp" or "relay".

        "door" is shared memory, which clients on the daemon's machine use by themselves; "relay"
        means that only the gateway's port can be reached.
        """
        return self.session.transport

    @overload
    def normalised_score(self, episode_return: float) -> float | None: ...

    @overload
    def normalised_score(
        self, episode_return: NDArray[Any] | Sequence[float]
    ) -> NDArray[np.float64] | None: ...

    def normalised_score(self, episode_return: Any) -> Any:
        """D4RL's score of a return, 0 to 100 between the references; None where there are none.

        An array of returns gives an array of scores of the same shape. InvalidArgumentError:
        `episode_return` is neither a number nor an array of numbers.
        """
        return self.session.spec.normalised_score(episode_return)

    @property
    def reference_min(self) -> float | None:
        """The return whose normalised score is 0: a random policy's."""
        return self.session.spec.reference_min

    @property
    def reference_max(self) -> float | None:
        """The return whose normalised score is 100: D4RL's expert's."""
        return self.session.spec.reference_max

    @property
    def _shape(self) -> tuple[int, ...]:
        """The shape of one observation."""
        return self.session.spec.observation.shape
