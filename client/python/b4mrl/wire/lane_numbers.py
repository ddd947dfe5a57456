"""The numbers by which steps happen exactly once, as the client counts them.

Each lane (one environment of a session) numbers its operations (Step, Reset, Restore) 1, 2, 3, ...;
a request carries the next number of every lane that it names, and a lane has at most one request
under way. A refused request has changed nothing, so its numbers are used again. When no answer
came, or one that leaves open what was executed, the lane is lost: a number that may be taken must
not be given to another operation. Lanes are 0-based; None means all of them, in order.

Thread rule: one thread at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from b4mrl.errors import BusyError, FailedPreconditionError, InvalidArgumentError

Lanes = NDArray[np.uint32]

_FREE, _BUSY, _LOST = 0, 1, 2


class LaneNumbers:
    """The counters of `count` lanes."""

    def __init__(self, count: int) -> None:
        self._last = np.zeros(count, np.uint64)  # number of the last executed operation
        self._state = np.zeros(count, np.uint8)

    @property
    def count(self) -> int:
        return len(self._last)

    def count_of(self, lanes: Lanes | None) -> int:
        return len(self._last) if lanes is None else len(lanes)

    def check_range(self, lanes: Lanes | None) -> None:
        """Raises FailedPreconditionError without lanes, InvalidArgumentError for a wrong one."""
        if len(self._last) == 0:
            raise FailedPreconditionError("the session has no lanes: it was opened for queries")
        if lanes is None:
            return
        if len(lanes) == 0:
            raise InvalidArgumentError("no lanes are named, allowed: at least 1")
        if lanes.max() >= len(self._last):
            raise InvalidArgumentError(f"lane is {lanes.max()}, allowed: 0..{len(self._last) - 1}")
        if len(np.unique(lanes)) < len(lanes):
            raise InvalidArgumentError("a lane is named twice, allowed: each once")

    def next_of(self, lanes: Lanes | None) -> NDArray[np.uint64]:
        """The numbers of the lanes' next operation.

        Raises what check_range does, BusyError, or FailedPreconditionError for a lost lane.
        """
        self.check_range(lanes)
        chosen = slice(None) if lanes is None else lanes
        state = self._state[chosen]
        if state.any():
            position = int(np.flatnonzero(state)[0])
            lane = position if lanes is None else lanes[position]
            if state[position] == _BUSY:
                raise BusyError(f"lane {lane} has a request under way; one at a time")
            raise FailedPreconditionError(
                f"the state of lane {lane} is not known since a request for it was not answered; "
                "open a new session"
            )
        numbers: NDArray[np.uint64] = self._last[chosen] + np.uint64(1)
        return numbers

    def begin(self, lanes: Lanes | None) -> None:
        """Marks lanes busy that next_of has numbers for."""
        self._state[slice(None) if lanes is None else lanes] = _BUSY

    def end(self, lanes: Lanes | None, numbers: NDArray[np.uint64], executed: bool | None) -> None:
        """Ends the operation `numbers` of `lanes`; None: not known whether it was executed.

        Ctrl-C may come between any two lines, so a second call does what the first one did.
        """
        chosen = slice(None) if lanes is None else lanes
        if executed:
            self._last[chosen] = numbers
        self._state[chosen] = _LOST if executed is None else _FREE
