"""How often an agent ends a HalfCheetah episode on its back, where it hardly moves any more.

    pip install ./client/python h5py
    python turned_over.py AGENT.h5 [--simulator gravity] [--episodes 100]

Prints the score, the rewards a step up to the last time that the torso was upright, in how many
episodes it is not at the end, and the rewards a step after that time.
"""

import argparse

import numpy as np

import b4mrl
from b4mrl.agent import load_agent

TORSO_ANGLE = 1  # in an observation, radians; 0 is upright
STEPS = 1000  # of an episode


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("agent")
    parser.add_argument("--simulator", help="perturbations; the true HalfCheetah without")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
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
