"""Statistics of a dataset, as the daemon computes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from b4mrl.display import Record
from b4mrl.values import Value


@dataclass(frozen=True, repr=False, eq=False)
class DatasetStats(Value, Record):
    """Statistics of a dataset.

    Attributes:
        observation_mean, observation_std: (observation size,) float64, of the rows as served; the
            standard deviation is the population's.
        rows, episodes: numbers of rows and of episodes.
        mean_return, std_return, min_return, max_return: undiscounted returns of the file's complete
            episodes.
        min_reward, max_reward: over all rows of the file.
    """

    observation_mean: NDArray[np.float64]
    observation_std: NDArray[np.float64]
    rows: int
    episodes: int
    mean_return: float
    std_return: float
    min_return: float
    max_return: float
    min_reward: float
    max_reward: float
