"""A hybrid learner of one's own, in PyTorch: TD3-BC on a dataset and on rollouts in a simulator.

    b4mrl benchmark run 'HalfCheetah/confounding/*' \
        --learner 'python client/examples/hybrid_pytorch.py' --name hybrid-pytorch

trains and scores it on each of these benchmarks; any benchmark with a dataset will do. Half of a
batch are rows of the dataset, half are steps that the policy has taken in the flawed simulator. The
critics learn from both halves; behaviour cloning holds the actor near the dataset's actions. TD3-BC
is Fujimoto and Gu's "A Minimalist Approach to Offline Reinforcement Learning" (2021), with its
hyperparameters. Nothing is chosen by scores: the true environment is not touched.
"""

from __future__ import annotations

import copy
from pathlib import Path

import b4mrl
import numpy as np
import torch
from torch import nn

BATCH = 256  # rows of an update, half from each source
LANES = 8  # environments that step at once in the simulator, every eighth update
HIDDEN = 256
DISCOUNT, SOFT_UPDATE = 0.99, 0.005
TARGET_NOISE, NOISE_CLIP, EXPLORATION = 0.2, 0.5, 0.1  # in units of the largest action, 1
ACTOR_EVERY = 2  # updates
CLONING = 2.5  # alpha of TD3-BC: the weight of the critic's value beside the cloning loss


def network(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, HIDDEN),
        nn.ReLU(),
        nn.Linear(HIDDEN, HIDDEN),
        nn.ReLU(),
        nn.Linear(HIDDEN, outputs),
    )


class Actor(nn.Module):
    """From normalised observations, 0 where the mask hides, to actions in [-1, 1].

    `act` is the policy of evaluations: from a batch of observations to one of actions. Here all
    rows are flat, as those of datasets are; Highway's environments show tables of 5 by 5.
    """

    def __init__(self, mean: np.ndarray, std: np.ndarray, mask: np.ndarray, actions: int) -> None:
        super().__init__()
        self.body = network(len(mean), actions)
        self.mean, self.std, self.mask = mean, std, mask.reshape(-1)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        return torch.tanh(self.body(inputs))

    def inputs(self, observations: np.ndarray) -> torch.Tensor:
        flat = observations.reshape(len(observations), -1)
        rows = np.where(self.mask, (flat - self.mean) / self.std, 0)
        return torch.as_tensor(rows, dtype=torch.float32)

    def act(self, observations: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return self(self.inputs(observations)).numpy()

    def save(self, path: Path, bench: b4mrl.Benchmark, seed: int, updates: int) -> None:
        b4mrl.save_agent(
            path,
            [(layer.weight, layer.bias) for layer in self.body if isinstance(layer, nn.Linear)],
            "relu",
            environment=bench.environment,
            mask=self.mask,
            observation_mean=self.mean,
            observation_std=self.std,
            algorithm="hybrid-pytorch",
            seed=seed,
            updates=updates,
        )


class Rollouts:
    """Steps of the policy in the simulator: all of them are kept, any of them drawn."""

    def __init__(self, bench: b4mrl.Benchmark, updates: int, rng: np.random.Generator) -> None:
        self.vec = bench.make_simulator(LANES, seed=int(rng.integers(2**32)))
        self.observations = self.vec.reset()[0].reshape(LANES, -1)
        self.ended = np.zeros(LANES, bool)
        rows = updates + LANES
        size, actions = self.observations.shape[1], self.vec.single_action_space.shape[0]
        self.rows = {
            "observations": np.zeros((rows, size), np.float32),
            "actions": np.zeros((rows, actions), np.float32),
            "rewards": np.zeros(rows, np.float32),
            "next_observations": np.zeros((rows, size), np.float32),
            "terminals": np.zeros(rows, bool),
        }
        self.count = 0
        self.rng = rng

    def step(self, actor: Actor) -> None:
        actions = actor.act(self.observations)
        actions += self.rng.normal(scale=EXPLORATION, size=actions.shape)
        actions = np.clip(actions, -1, 1).astype(np.float32)
        observations, rewards, terminated, truncated, _ = self.vec.step(actions)
        observations = observations.reshape(LANES, -1)
        new = ~self.ended  # the step after an episode's end only begins the next episode
        place = slice(self.count, self.count + int(new.sum()))
        columns = (self.observations, actions, rewards, observations, terminated)
        for row, column in zip(self.rows.values(), columns, strict=True):
            row[place] = column[new]
        self.count = place.stop
        self.observations, self.ended = observations, terminated | truncated

    def sample(self, rows: int) -> dict[str, np.ndarray]:
        chosen = self.rng.integers(self.count, size=rows)
        return {name: column[chosen] for name, column in self.rows.items()}


def train(bench: b4mrl.Benchmark, seed: int, updates: int) -> Actor:
    """The actor after `updates` gradient steps of the critics."""
    if bench.dataset is None:
        raise SystemExit(f"{bench.name} has no dataset, which this learner needs")
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    stats = bench.dataset.stats()
    actor = Actor(
        stats.observation_mean,
        stats.observation_std + 1e-3,
        bench.mask,
        bench.dataset.action_size,
    )
    critics = [network(len(actor.mean) + bench.dataset.action_size, 1) for _ in range(2)]
    targets = copy.deepcopy([actor, *critics])
    actor_optimizer = torch.optim.Adam(actor.parameters(), lr=3e-4)
    critic_optimizer = torch.optim.Adam([p for c in critics for p in c.parameters()], lr=3e-4)

    rollouts = Rollouts(bench, updates, rng)
    for update, logged in zip(
        range(updates), bench.dataset.stream(BATCH // 2, seed=seed), strict=False
    ):
        if update % LANES == 0:
            rollouts.step(actor)
        simulated = rollouts.sample(BATCH // 2)
        both = {name: np.concatenate([logged[name], simulated[name]]) for name in simulated}
        inputs, actions = actor.inputs(both["observations"]), torch.as_tensor(both["actions"])
        wanted = target_values(targets, actor.inputs(both["next_observations"]), both)
        values = [critic(torch.cat([inputs, actions], 1)) for critic in critics]
        critic_optimizer.zero_grad()
        sum(nn.functional.mse_loss(value, wanted) for value in values).backward()
        critic_optimizer.step()
        if update % ACTOR_EVERY:
            continue
        inputs, actions = inputs[: BATCH // 2], actions[: BATCH // 2]  # the dataset's half
        chosen = actor(inputs)
        value = critics[0](torch.cat([inputs, chosen], 1))
        weight = CLONING / value.abs().mean().detach()
        actor_optimizer.zero_grad()
        (nn.functional.mse_loss(chosen, actions) - weight * value.mean()).backward()
        actor_optimizer.step()
        for target, online in zip(targets, [actor, *critics], strict=True):
            for old, new in zip(target.parameters(), online.parameters(), strict=True):
                old.data.lerp_(new.data, SOFT_UPDATE)
    return actor


@torch.no_grad()
def target_values(
    targets: list[nn.Module], inputs: torch.Tensor, batch: dict[str, np.ndarray]
) -> torch.Tensor:
    actor, *critics = targets
    actions = actor(inputs)
    noise = (TARGET_NOISE * torch.randn_like(actions)).clamp(-NOISE_CLIP, NOISE_CLIP)
    pairs = torch.cat([inputs, (actions + noise).clamp(-1, 1)], 1)
    values = torch.minimum(*(critic(pairs) for critic in critics))
    continues = torch.as_tensor(~batch["terminals"], dtype=torch.float32)[:, None]
    return torch.as_tensor(batch["rewards"])[:, None] + DISCOUNT * continues * values


def main() -> None:
    torch.set_num_threads(1)  # the runner trains as many learners at once as there are cores
    bench = b4mrl.benchmark()  # the one that the runner asks for
    assert bench.updates is not None and bench.out is not None
    actor = train(bench, bench.seed, bench.updates)
    actor.save(bench.out / "agent.h5", bench, bench.seed, bench.updates)


if __name__ == "__main__":
    main()
