"""The client's counters of each lane's operations, by which the daemon executes each of them once.

The operations (Step, Reset, Restore) of a lane (one environment of a session) are numbered from 1.
A request carries the next number of every lane that it names, and a lane has at most one request
under way. A refused request has changed nothing, so its numbers are used again. If it is not known
whether an operation was executed, and sending it again cannot tell, the lane is lost: its number
may be taken and must not be given to another operation. Lanes are 0-based; None means all lanes.

Thread rule: one thread at a time.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from b4mrl.errors import B4mrlError, BusyError, FailedPreconditionError, InvalidArgumentError

Lanes = NDArray[np.uint32]

_FREE, _BUSY, _LOST = 0, 1, 2
_EVERY = slice(None)
_ONE = np.uint64(1)


class LaneNumbers:
    """The counters of `count` lanes."""

    def __init__(self, count: int) -> None:
        self._last = np.zeros(count, np.uint64)  # number of the last executed operation
        # A lane is busy or lost by an operation of all lanes, or by one of some lanes.
        self._state_of_all = _FREE
        self._state = np.zeros(count, np.uint8)
        self._were_apart = False  # some lanes ever had an operation without the others

    @property
    def count(self) -> int:
        return len(self._last)

    def count_of(self, lanes: Lanes | None) -> int:
        return len(self._last) if lanes is None else len(lanes)

    def check_range(self, lanes: Lanes | None) -> None:
        """Checks that the lanes exist and that each is named once.

        FailedPreconditionError: the session has no lanes. InvalidArgumentError: a lane is wrong.
        """
        if len(self._last) == 0:
            raise FailedPreconditionError("the session has no lanes: it was opened for queries")
        if lanes is None:
            return
        if len(lanes) == 0:
            raise InvalidArgumentError("no lanes are named, allowed: at least 1")
        if lanes.max() >= len(self._last):
            raise InvalidArgumentError(f"lane is {lanes.max()}, allowed: 0..{len(self._last) - 1}")
        if len(np.unique(lanes)) < len(lanes):
            raise InvalidArgumentError("a lane is named twice, allowed: each lane once")

    def next_of(self, lanes: Lanes | None) -> NDArray[np.uint64]:
        """The numbers of the lanes' next operation.

        BusyError: a lane has a sent step under way. FailedPreconditionError: a lane is lost. Also
        raises the errors of check_range.
        """
        self.check_range(lanes)
        chosen = _EVERY if lanes is None else lanes
        if self._state_of_all != _FREE:
            raise _refusal(0 if lanes is None else int(lanes[0]), self._state_of_all)
        if self._were_apart:
            state = self._state[chosen]
            if state.any():
                position = int(np.flatnonzero(state)[0])
                lane = position if lanes is None else int(lanes[position])
                raise _refusal(lane, int(state[position]))
        numbers: NDArray[np.uint64] = self._last[chosen] + _ONE
        return numbers

    def begin(self, lanes: Lanes | None) -> None:
        """Marks lanes as busy, after next_of returned their numbers."""
        self._mark(lanes, _BUSY)

    def end(self, lanes: Lanes | None, numbers: NDArray[np.uint64], executed: bool | None) -> None:
        """Ends the operation `numbers` of `lanes`. `executed` is None if that is not known.

        A second call with the same arguments has no effect, as Ctrl-C may interrupt the first one.
        """
        if executed:
            self._last[_EVERY if lanes is None else lanes] = numbers
        self._mark(lanes, _LOST if executed is None else _FREE)

    def _mark(self, lanes: Lanes | None, state: int) -> None:
        if lanes is None:
            self._state_of_all = state
        else:
            self._were_apart = True
            self._state[lanes] = state


def _refusal(lane: int, state: int) -> B4mrlError:
    if state == _BUSY:  # by a sent step alone: interrupted operations are ended before this check
        return BusyError(
            f"lane {lane} has a sent step under way, allowed: one at a time; call recv first"
        )
    return FailedPreconditionError(
        f"the state of lane {lane} is unknown since an earlier error; make the environment anew"
    )
