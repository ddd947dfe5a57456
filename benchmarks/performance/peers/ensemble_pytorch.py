"""MOPO's dynamics ensemble in plain PyTorch: all members in one batched product."""

from collections.abc import Callable

import torch
from torch import nn
from torch.nn import functional

import sizes

MEMBERS, WIDTH = 7, 200
DECAY = [2.5e-5, 5e-5, 7.5e-5, 7.5e-5, 1e-4]


class EnsembleLinear(nn.Module):
    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        bound = inputs**-0.5
        self.weight = nn.Parameter(torch.empty(MEMBERS, inputs, outputs).uniform_(-bound, bound))
        self.bias = nn.Parameter(torch.empty(MEMBERS, 1, outputs).uniform_(-bound, bound))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.baddbmm(self.bias, x, self.weight)


class Ensemble(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.outputs = sizes.OBSERVATION + 1
        widths = [sizes.OBSERVATION + sizes.ACTION] + [WIDTH] * 4 + [2 * self.outputs]
        self.layers = nn.ModuleList(EnsembleLinear(*pair) for pair in zip(widths, widths[1:]))
        self.max_log_var = nn.Parameter(torch.full((self.outputs,), 0.5))
        self.min_log_var = nn.Parameter(torch.full((self.outputs,), -10.0))

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        for layer in self.layers[:-1]:
            x = functional.silu(layer(x))
        mean, log_var = self.layers[-1](x).chunk(2, dim=-1)
        log_var = self.max_log_var - functional.softplus(self.max_log_var - log_var)
        return mean, self.min_log_var + functional.softplus(log_var - self.min_log_var)


def ensemble() -> Callable[[], None]:
    torch.manual_seed(0)
    model = Ensemble()
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-3)
    inputs = torch.randn(sizes.BATCH, sizes.OBSERVATION + sizes.ACTION)
    inputs = inputs.expand(MEMBERS, -1, -1)
    target = torch.randn(sizes.BATCH, sizes.OBSERVATION + 1)

    def update() -> None:
        mean, log_var = model(inputs)
        error = (mean - target) ** 2 * torch.exp(-log_var)
        loss = error.mean(dim=(1, 2)).sum() + log_var.mean(dim=(1, 2)).sum()
        loss = loss + sum(
            decay * layer.weight.square().sum() for decay, layer in zip(DECAY, model.layers)
        )
        loss = loss + 0.01 * (model.max_log_var.sum() - model.min_log_var.sum())
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()

    return update
