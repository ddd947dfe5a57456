"""Stable-Baselines3's SAC and TD3, with the networks that b4mrl has: two hidden layers of 256."""

from collections.abc import Callable

import gymnasium
import numpy as np
from stable_baselines3 import SAC, TD3
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.type_aliases import ReplayBufferSamples

import sizes


class Spaces(gymnasium.Env):
    """An environment with HalfCheetah's spaces, which is never stepped."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (sizes.OBSERVATION,), np.float32)
    action_space = gymnasium.spaces.Box(-1.0, 1.0, (sizes.ACTION,), np.float32)


def _updates(algorithm: type[OffPolicyAlgorithm]) -> Callable[[], None]:
    model = algorithm(
        "MlpPolicy",
        Spaces(),
        batch_size=sizes.BATCH,
        buffer_size=1,
        policy_kwargs={"net_arch": sizes.HIDDEN},
        device="cpu",
        seed=0,
    )
    model.set_logger(Logger(folder=None, output_formats=[]))
    batch = sizes.random_batch()
    samples = ReplayBufferSamples(
        batch.observations,
        batch.actions,
        batch.next_observations,
        1 - batch.not_terminated,
        batch.rewards,
    )
    model.replay_buffer.sample = lambda *_, **__: samples  # type: ignore[method-assign]
    # One gradient step per call, as SAC and TD3 do after every environment step by default.
    return lambda: model.train(gradient_steps=1, batch_size=sizes.BATCH)


def sac() -> Callable[[], None]:
    return _updates(SAC)


def td3() -> Callable[[], None]:
    return _updates(TD3)
