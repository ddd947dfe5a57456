"""Shared by all peers: HalfCheetah's sizes and a batch with plausible numbers."""

from typing import NamedTuple

import torch

OBSERVATION = 17
ACTION = 6
BATCH = 256
HIDDEN = [256, 256]


class Batch(NamedTuple):
    observations: torch.Tensor
    actions: torch.Tensor
    rewards: torch.Tensor
    next_observations: torch.Tensor
    not_terminated: torch.Tensor


def random_batch() -> Batch:
    torch.manual_seed(0)
    return Batch(
        torch.randn(BATCH, OBSERVATION),
        0.5 * torch.sign(torch.randn(BATCH, ACTION)),
        torch.ones(BATCH, 1),
        torch.randn(BATCH, OBSERVATION),
        torch.ones(BATCH, 1),
    )
