"""Implicit Q-learning in plain PyTorch: deterministic actor, two critics, value network."""

import copy
from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional

import sizes

GAMMA, TAU, EXPECTILE, TEMPERATURE, WEIGHT_MAX = 0.99, 0.005, 0.7, 3.0, 100.0


def network(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(inputs, sizes.HIDDEN[0]),
        nn.ReLU(),
        nn.Linear(sizes.HIDDEN[0], sizes.HIDDEN[1]),
        nn.ReLU(),
        nn.Linear(sizes.HIDDEN[1], outputs),
    )


class Critics(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.first = network(sizes.OBSERVATION + sizes.ACTION, 1)
        self.second = network(sizes.OBSERVATION + sizes.ACTION, 1)

    def forward(self, s: torch.Tensor, a: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        x = torch.cat([s, a], dim=1)
        return self.first(x), self.second(x)


def iql() -> Callable[[], None]:
    batch = sizes.random_batch()
    actor = nn.Sequential(network(sizes.OBSERVATION, sizes.ACTION), nn.Tanh())
    value = network(sizes.OBSERVATION, 1)
    critics = Critics()
    targets = copy.deepcopy(critics)
    actor_optimiser = torch.optim.Adam(actor.parameters(), lr=3e-4)
    value_optimiser = torch.optim.Adam(value.parameters(), lr=3e-4)
    critics_optimiser = torch.optim.Adam(critics.parameters(), lr=3e-4)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(actor_optimiser, 1_000_000)

    def step(optimiser: torch.optim.Optimizer, loss: torch.Tensor) -> None:
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

    def update() -> None:
        s, a, r, next_s, not_terminated = batch
        with torch.no_grad():
            q = torch.min(*targets(s, a))
        advantage = q - value(s)
        weight = torch.where(advantage > 0, EXPECTILE, 1 - EXPECTILE)
        step(value_optimiser, (weight * advantage**2).mean())

        with torch.no_grad():
            weight = torch.exp(TEMPERATURE * (q - value(s))).clamp(max=WEIGHT_MAX)
        step(actor_optimiser, (weight * (actor(s) - a) ** 2).mean())
        schedule.step()

        with torch.no_grad():
            y = r + not_terminated * GAMMA * value(next_s)
        q1, q2 = critics(s, a)
        step(critics_optimiser, functional.mse_loss(q1, y) + functional.mse_loss(q2, y))
        with torch.no_grad():
            for online, target in zip(critics.parameters(), targets.parameters()):
                target.lerp_(online, TAU)

    return update
