"""Evaluations: whole episodes of a policy, and the dimensions that they hide from it."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from b4mrl.agent import Policy, load_agent
from b4mrl.benchmarks.seeds import role_seed
from b4mrl.dataset import Dataset
from b4mrl.display import Record
from b4mrl.errors import InternalError, InvalidArgumentError
from b4mrl.simulators import NamedArgument
from b4mrl.spec import SpaceSpec
from b4mrl.values import Value
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.wire import checks
from b4mrl.wire.arrays import Array

# A function from observations to actions, or an agent's file.
PolicyLike = Callable[[Array], ArrayLike] | str | os.PathLike[str]

_GIVEN_UP = ("crash", "numerical_error")  # causes of an end that no rule of the task demands


@dataclass(frozen=True, repr=False, eq=False)
class Evaluation(Value, Record):
    """What a policy reached in its episodes.

    Attributes:
        score: D4RL's normalised score of the mean return; None where the task has no reference.
        mean_return, std_return: of the undiscounted returns; the population's standard deviation.
        returns, lengths: (episodes,) each episode's undiscounted return and number of steps.
        given_up: number of episodes that the daemon or the physics engine ended through no rule of
            the task; they count with their return until then.
    """

    score: float | None
    mean_return: float
    std_return: float
    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    given_up: int


def policy_of(policy: PolicyLike, environment: str, unmasked: bool) -> Callable[[Array], ArrayLike]:
    """`policy` as a function; `unmasked` lifts the mask that an agent brings along.

    InvalidArgumentError: it is neither a function nor a file's path, or the agent was trained in
    another environment.
    """
    if isinstance(policy, str | os.PathLike):
        policy = load_agent(policy)
    if not callable(policy):
        raise InvalidArgumentError(
            f"policy is {reprlib.repr(policy)}, allowed: a function from observations to actions, "
            "or the path of an agent's file"
        )
    if not isinstance(policy, Policy):
        return policy
    if policy.environment not in ("", environment):
        raise InvalidArgumentError(
            f"the agent's environment is {policy.environment!r}, allowed: {environment!r}"
        )
    return policy.unmasked() if unmasked else policy


def play(
    vec: VectorEnvironment, policy: Callable[[Array], ArrayLike], mask: NDArray[np.bool_], seed: int
) -> Evaluation:
    """One episode in each environment of `vec`, which never resets itself (mode disabled).

    Episode i starts from the seed role_seed(seed, "evaluation", i), as those of `b4mrl evaluate`.

    Args:
        policy: called with a batch of observations (episodes, *shape). If it raises an error then
            or returns another shape than (episodes, *action shape), it is called with one
            observation at a time instead, and plays one episode after the other. In a batch, row i
            belongs to episode i; it stays there when the episode has ended. A policy with a method
            `reset` gets it called before its episodes.
        mask: dimensions that the policy may see; it gets 0 for the others.

    InvalidArgumentError: the policy takes neither.
    """
    first = vec.reset(seed=[role_seed(seed, "evaluation", i) for i in range(vec.num_envs)])[0]
    episodes = _Episodes(vec)
    _begin(policy)
    try:
        actions = _checked(policy(_seen(first, mask)), (vec.num_envs, *episodes.action_shape))
    except Exception as error:
        _play_in_turn(episodes, policy, mask, first, error)
    else:
        _play_together(episodes, policy, mask, actions)
    mean = float(episodes.returns.mean())
    return Evaluation(
        score=vec.session.spec.normalised_score(mean),
        mean_return=mean,
        std_return=float(episodes.returns.std()),
        returns=episodes.returns,
        lengths=episodes.lengths,
        given_up=episodes.given_up,
    )


def given_returns(returns: ArrayLike | None) -> NDArray[np.float64]:
    """Returns of episodes that a caller gives; none of them for None.

    InvalidArgumentError: they are no list of finite numbers, or an empty one.
    """
    allowed = "at least one finite number, one an episode"
    given = checks.array("returns", [] if returns is None else returns, allowed, np.float64)
    if given.ndim != 1 or not np.isfinite(given).all() or (returns is not None and not len(given)):
        raise InvalidArgumentError(f"returns are {returns!r}, allowed: {allowed}")
    return given


def hidden_in(dataset: Dataset, space: SpaceSpec) -> list[int]:
    """Indices of the dimensions that a dataset hides. InternalError: there is no such dimension."""
    hidden = list(dataset.hidden_dimensions)
    for dimension in hidden:
        if dimension >= space.size:
            raise InternalError(f"the server's reply hides dimension {dimension} of {space.size}")
    return hidden


def hidden_by(perturbations: tuple[NamedArgument, ...], space: SpaceSpec) -> list[int]:
    """Indices of the dimensions that perturbations in parametric form hide.

    InvalidArgumentError: there is no such dimension.
    """
    hidden = [item.argument for item in perturbations if item.name == "hidden"]
    names = [name for argument in hidden for name in argument.split("+")]
    for name in names:
        if not (name.isascii() and name.isdigit() and int(name) < space.size):
            raise InvalidArgumentError(
                f"hidden dimension is '{name}', allowed: a whole number in 0..{space.size - 1}"
            )
    return [int(name) for name in names]


class _Episodes:
    """Steps the episodes that have not ended, and adds up what they return."""

    def __init__(self, vec: VectorEnvironment) -> None:
        self.vec = vec
        self.returns = np.zeros(vec.num_envs)
        self.lengths = np.zeros(vec.num_envs, np.int64)
        self.given_up = 0
        self.open = np.arange(vec.num_envs)
        self.action_shape = vec.session.spec.action.shape

    def step(self, actions: Array, lanes: NDArray[np.int64]) -> Array:
        """One step of the open episodes `lanes`; returns their observations."""
        self.vec.send(actions, lanes)
        observations, rewards, terminated, truncated, info = self.vec.recv()
        self.returns[lanes] += rewards
        self.lengths[lanes] += 1
        ended = terminated | truncated
        if ended.any():
            self.given_up += sum(cause in _GIVEN_UP for cause in info["cause"])
            self.open = np.setdiff1d(self.open, lanes[ended])
        return observations


def _play_together(
    episodes: _Episodes,
    policy: Callable[[Array], ArrayLike],
    mask: NDArray[np.bool_],
    actions: Array,
) -> None:
    shape = actions.shape
    seen = np.zeros((len(actions), *mask.shape), np.float32)
    while True:
        lanes = episodes.open
        seen[lanes] = _seen(episodes.step(actions[lanes], lanes), mask)
        if len(episodes.open) == 0:
            return
        actions = _checked(policy(seen.copy()), shape)


def _play_in_turn(
    episodes: _Episodes,
    policy: Callable[[Array], ArrayLike],
    mask: NDArray[np.bool_],
    first: Array,
    reason: Exception,
) -> None:
    for lane in range(len(first)):
        observation = first[lane]
        _begin(policy)
        while lane in episodes.open:
            try:
                action = _checked(policy(_seen(observation, mask)), episodes.action_shape)
            except Exception as error:
                if episodes.lengths[0] > 0:
                    raise
                raise InvalidArgumentError(
                    f"the policy takes neither a batch of observations ({reason}) nor one "
                    f"observation ({error})"
                ) from error
            (observation,) = episodes.step(action[None], np.array([lane]))


def _seen(observations: Array, mask: NDArray[np.bool_]) -> Array:
    return np.where(mask, observations, np.float32(0))


def _checked(given: Any, shape: tuple[int, ...]) -> Array:
    """A policy's answer as float32, the precision of agents' files and of `b4mrl evaluate`."""
    actions = np.asarray(given, np.float32)
    if actions.shape != shape:
        raise InvalidArgumentError(
            f"the policy's answer has shape {actions.shape}, allowed: {shape}"
        )
    return actions


def _begin(policy: Any) -> None:
    reset = getattr(policy, "reset", None)
    if callable(reset):
        reset()
