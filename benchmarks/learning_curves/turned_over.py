"""Counts the HalfCheetah episodes that an agent ends on its back, where it hardly moves.

    pip install ./client/python h5py
    python turned_over.py AGENT.h5 [--simulator gravity] [--episodes 100]

Prints the score, the mean reward of a step up to the last step with the torso upright, the number
of episodes that end with the torso turned over, and the mean reward of a step after that.
"""

import argparse

import numpy as np

import b4mrl
from b4mrl.agent import load_agent

TORSO_ANGLE = 1  # in an observation, radians; 0 is upright
STEPS = 1000  # of an episode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("agent", help="agent file of `b4mrl train`")
    parser.add_argument("--simulator", help="perturbations; without, the true HalfCheetah")
    parser.add_argument("--episodes", type=int, default=100, help="number of episodes")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first episode")
    arguments = parser.parse_args()
    policy = load_agent(arguments.agent)
    rewards = np.empty((STEPS, arguments.episodes))
    upright = np.empty(rewards.shape, bool)
    with b4mrl.serve() as endpoint:
        environments = b4mrl.connect(endpoint).make_vec(
            "HalfCheetah", arguments.episodes, arguments.simulator, seed=arguments.seed
        )
        observations, _ = environments.reset()
        for step in range(STEPS):
            upright[step] = np.cos(observations[:, TORSO_ANGLE]) > 0
            observations, rewards[step], *_ = environments.step(policy(observations))
        score = environments.session.spec.normalised_score(rewards.sum(axis=0).mean())

    stays_over = np.logical_and.accumulate(~upright[::-1])[::-1]
    print(f"score {score:.1f}, rewards a step {rewards[~stays_over].mean():.2f}")
    if stays_over.any():
        print(
            f"{stays_over[-1].sum()} of {arguments.episodes} episodes end turned over, "
            f"then {rewards[stays_over].mean():.2f}"
        )


if __name__ == "__main__":
    main()
