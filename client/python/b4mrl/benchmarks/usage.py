"""What a learner has used since its last result: time, and what the daemon's ledger counted."""

from __future__ import annotations

import contextlib
import functools
import time
from typing import TYPE_CHECKING

from b4mrl.benchmarks.ledger import Ledger
from b4mrl.errors import UnknownNameError

if TYPE_CHECKING:
    from b4mrl.client import Client


# Names of the counts in results; evaluation_episodes stands beside them (b4mrl.benchmarks.curve).
_COUNTS = ("simulator_steps", "query_rows", "dataset_rows")


def is_learning(counts: dict[str, int]) -> bool:
    """Whether a learner has used anything by these counts; evaluations are none of its use."""
    return any(counts[name] for name in _COUNTS)


class Usage:
    """The use of a benchmark's simulator and dataset.

    It is counted by a ledger of the daemon, which is opened at the first use.

    Args:
        client: whose daemon counts.
        ledger: number of the ledger for what learning uses; 0 opens a new one.
    """

    def __init__(self, client: Client, ledger: int = 0) -> None:
        self._client = client
        self._number = ledger
        self._began: float | None = None
        self._last = dict.fromkeys(_COUNTS, 0)
        self._before = self._last

    @functools.cached_property
    def learning(self) -> Ledger:
        """The ledger of what learning uses."""
        return self._client.ledger(self._number)

    def begin(self) -> None:
        """Lets the time of the first result begin, unless it has."""
        if self._began is None:
            self._began = time.monotonic()

    def counts(self) -> dict[str, int]:
        """The counts since the last result, for its entry `ledger`."""
        now = self._totals()
        return {name: count - self._before[name] for name, count in now.items()}

    def seconds(self) -> float:
        """Time since the last result, or since learning began."""
        return 0.0 if self._began is None else time.monotonic() - self._began

    def restart(self) -> None:
        """Begins anew, for the next result."""
        self._before = self._totals()
        self._began = time.monotonic()

    def _totals(self) -> dict[str, int]:
        """The ledger's totals; the last ones where the daemon has lost the ledger."""
        with contextlib.suppress(UnknownNameError):
            learning = self.learning.counts()
            counts = (learning.steps, learning.query_rows, learning.dataset_rows)
            self._last = dict(zip(_COUNTS, counts))
        return self._last
