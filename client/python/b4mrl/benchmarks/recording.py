"""The recording of a user's run: what its result says beyond the scores of its policy."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl.benchmarks import result_file
from b4mrl.benchmarks.evaluation import Evaluation
from b4mrl.benchmarks.result_file import Point
from b4mrl.descriptions import BenchmarkInfo, DatasetInForce
from b4mrl.errors import FailedPreconditionError, InvalidArgumentError


@dataclass(frozen=True)
class Use:
    """What a run has used since the benchmark's last result, as the result will say it.

    Attributes:
        ledger: the counts, by name.
        seconds: the time of its training.
        curve: its evaluations; the last one is the result's own.
        has_learned: whether the counts are of a training.
    """

    ledger: dict[str, int]
    seconds: float
    curve: list[Point]
    has_learned: bool


class Recording:
    """The result of one run in a folder of results.

    Args:
        info, algorithm, seed, updates: what was trained, and how long.
        folder: of results; need not be there yet.
        dataset: as the daemon serves it; None for a benchmark without one.

    FailedPreconditionError: the folder has a result of the run with more updates.
    """

    def __init__(
        self,
        info: BenchmarkInfo,
        algorithm: str,
        seed: int,
        updates: int,
        folder: Path,
        dataset: DatasetInForce | None,
    ) -> None:
        self._info, self._algorithm, self._seed, self._updates = info, algorithm, seed, updates
        self._folder, self._dataset = folder, dataset
        self._earlier = result_file.earlier(folder, info, algorithm, seed, dataset)
        if self._earlier is not None and self._earlier.updates > updates:
            raise FailedPreconditionError(
                f"{self._earlier.path} has a result of {self._earlier.updates} updates, allowed: "
                f"as many or more than that; remove it to begin anew"
            )

    def write(self, returns: NDArray[np.float64], use: Use, own: Mapping[str, Any]) -> Path:
        """Writes the file, and returns its path.

        Args:
            returns: of the episodes of the result.
            own: further entries, by name.
        """
        curve, ledger, seconds = use.curve, use.ledger, use.seconds
        earlier = self._earlier
        if earlier is not None and earlier.repeats(self._updates, curve) and not use.has_learned:
            curve, ledger, seconds = earlier.with_end(curve[-1]), earlier.ledger, earlier.seconds
        entries = result_file.entries_of(
            self._info, self._algorithm, self._seed, self._dataset, returns, curve
        )
        entries |= {"ledger": ledger, "seconds": round(seconds, 3), **own}
        return result_file.write(self._folder, self._info, entries)


def scoring_of(observe: str, world: str, scores: Evaluation) -> dict[str, Any]:
    """The entry of a further evaluation, in the environment that `world` perturbs.

    `observe` is "full" or "served", as for Benchmark.evaluate.
    """
    return {
        "simulator": world,
        "observe": "full" if observe == "full" else "trained",
        "score": scores.score,
        "return": scores.mean_return,
        "returns": scores.returns.tolist(),
    }


def check_source(policy: Any, returns: Any) -> None:
    """InvalidArgumentError: both or none of policy and returns are given."""
    if (policy is None) == (returns is None):
        given = "None" if policy is None else "given"
        raise InvalidArgumentError(f"policy and returns are both {given}, allowed: one of them")


def source_of(policy: Any) -> dict[str, Any]:
    """The entries that say who has scored the run: with `policy`, or without one its user."""
    source = {"source": "self-scored" if policy is None else "user"}
    if isinstance(policy, str | os.PathLike):
        source["agent_sha256"] = result_file.sha256_of(policy)
    return source
