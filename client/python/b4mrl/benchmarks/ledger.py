"""Ledgers: what a learner has used, counted by the daemon.

ledger = client.ledger()
env = client.make("HalfCheetah", "gravity", ledger=ledger)
data = client.dataset("HalfCheetah/medium", ledger=ledger)
...
ledger.counts()  # <LedgerCounts steps=1000, episodes=1, query_rows=0, dataset_rows=25600>
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from b4mrl.display import Record, Shown
from b4mrl.wire import checks
from b4mrl.wire.messages import Request


@dataclass(frozen=True, repr=False)
class LedgerCounts(Record):
    """Totals of a ledger since it was opened.

    Attributes:
        steps: steps simulated, each environment counted; a step in mode "next_step" that only
            begins an episode is none.
        episodes: episodes that ended in a step.
        query_rows: rows of queries.
        dataset_rows: rows of datasets that were sampled or read.
    """

    steps: int
    episodes: int
    query_rows: int
    dataset_rows: int


class Ledger(Shown):
    """A ledger of a daemon; Client.ledger returns it.

    Environments, queries and datasets that were given the ledger add to its totals, in whatever
    process they are. Its number may be given in its place, also in another process. Thread rule:
    that of its client, whose connection it uses.

    Args:
        ask: sends a request to the daemon's gateway and returns the reply.
        number: of the ledger; 0 opens a new one.

    Raises:
        UnknownNameError: the daemon has no ledger of that number.

    Attributes:
        number: names the ledger in the daemon.
    """

    def __init__(self, ask: Callable[[Any], Any], number: int = 0) -> None:
        self._ask = ask
        self.number: int = self._read(checks.unsigned("ledger", number)).ledger

    def counts(self) -> LedgerCounts:
        """The totals until now.

        Raises:
            UnknownNameError: the daemon does not have the ledger any more. A daemon that has no
                room for another ledger gives up the one that was unused for longest.
        """
        totals = self._read(self.number)
        return LedgerCounts(totals.steps, totals.episodes, totals.query_rows, totals.dataset_rows)

    def _read(self, number: int) -> Any:
        request = Request()
        request.ledger.ledger = number
        request.ledger.SetInParent()  # also where the number is 0
        return self._ask(request).ledger

    def _facts(self) -> Mapping[str, Any]:
        return {"number": self.number}


LedgerLike = Ledger | int | None


def number_of(ledger: LedgerLike) -> int | None:
    """The number of `ledger`. InvalidArgumentError: `ledger` is something else."""
    if ledger is None:
        return None
    return checks.unsigned("ledger", ledger.number if isinstance(ledger, Ledger) else ledger)
