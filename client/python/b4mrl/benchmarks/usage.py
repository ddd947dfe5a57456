"""What a learner has used since its last result: time, and what the daemon's ledger counted."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

from b4mrl.benchmarks.ledger import Ledger
from b4mrl.errors import UnknownNameError, warn

if TYPE_CHECKING:
    from b4mrl.client import Client


# Names of the counts in results; evaluation_episodes stands beside them (b4mrl.benchmarks.curve).
_COUNTS = ("simulator_steps", "query_rows", "dataset_rows")


class Usage:
    """The use of a benchmark's simulator and dataset.

    It is counted by a ledger of the daemon, which is opened at the first use. A process that was
    forked has a ledger of its own, unless a number was given.

    Args:
        client: whose daemon counts.
        ledger: number of the ledger for what learning uses; 0 opens a new one.
    """

    def __init__(self, client: Client, ledger: int = 0) -> None:
        self._client = client
        self._given = ledger
        self._begin_anew()

    def _begin_anew(self) -> None:
        self._process = os.getpid()
        self._ledger: Ledger | None = None
        self._began: float | None = None
        self._last = dict.fromkeys(_COUNTS, 0)  # the ledger's totals when they were last read
        self._before = self._last  # and at the last result; below 0 for what a lost ledger had
        self._is_partial = False  # whether counts lack what a lost ledger had

    def _leave_parent(self) -> None:
        if self._process != os.getpid():
            self._begin_anew()

    @property
    def learning(self) -> Ledger:
        """The ledger of what learning uses; what was opened for an earlier one counts nowhere."""
        self._leave_parent()
        if self._ledger is None:
            self._ledger = self._client.ledger(self._given)
        return self._ledger

    def begin(self) -> None:
        """Lets the time of the first result begin, unless it has."""
        self._leave_parent()
        if self._began is None:
            self._began = time.monotonic()

    def counts(self) -> dict[str, int]:
        """The counts since the last result, for its entry `ledger`."""
        now = self._totals()
        return {name: count - self._before[name] for name, count in now.items()}

    def has_learned(self, counts: dict[str, int]) -> bool:
        """Whether anything was used by these `counts`, or may have been; evaluations are no use."""
        return self._is_partial or any(counts[name] for name in _COUNTS)

    def seconds(self) -> float:
        """Time since the last result, or since learning began."""
        self._leave_parent()
        return 0.0 if self._began is None else time.monotonic() - self._began

    def restart(self) -> None:
        """Begins anew, for the next result."""
        self._before = self._totals()
        self._began = time.monotonic()
        self._is_partial = False

    def _totals(self) -> dict[str, int]:
        """The ledger's totals, as far as they are known."""
        self._leave_parent()
        if self._ledger is None and self._given == 0:
            return self._last  # nothing was used since the last one
        try:
            learning = self.learning.counts()
        except UnknownNameError:
            self._forget()
            return self._last
        counts = (learning.steps, learning.query_rows, learning.dataset_rows)
        self._last = dict(zip(_COUNTS, counts, strict=True))
        return self._last

    def _forget(self) -> None:
        """Goes on with another ledger: a daemon that was restarted has none of the old ones."""
        warn(
            "the daemon has lost the ledger of what learning used, as one that was restarted has: "
            "the next result counts less than was used"
        )
        self._ledger = None
        self._given = 0
        self._before = {name: self._before[name] - self._last[name] for name in _COUNTS}
        self._last = dict.fromkeys(_COUNTS, 0)
        self._is_partial = True
