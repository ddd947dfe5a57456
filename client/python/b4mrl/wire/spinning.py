"""Decides whether a wait for another process is spent looking again and again, before a sleep.

Waking a sleeping thread of an idle core takes about 60 us, as long as two steps of a simulation. So
a wait that will probably end within the budget is spent looking, and a longer one asleep.

Between looks the thread yields its core, because the kernel often puts both processes on one core.
On a busy machine a yield hands the core to a third process for milliseconds. So after such a loss
the spinner rests for many times as long as that took, which bounds what looking can cost to a few
percent. After looking in vain, which took nothing from anybody, it rests for a shorter time.

Thread rule: one thread at a time.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

_WAKE_UP = 60e-6  # seconds, as all times here
_LOOKS = 64  # between two yields: about 2 us
# A longer time between two looks at the clock: a third process had the core in between, since the
# peer takes less time for whatever is worth a wait without sleep.
_LOST_SLICE = 500e-6
_RESTS_AFTER_LOSS = 32  # times the loss
_RESTS_IN_VAIN = 8  # times the budget
_LONGEST_LEARNT = 500e-6  # longer waits count as this, so that shorter ones are noticed soon
_MEMORY = 8  # waits
_OTHERS_INTERVAL = 20e-3  # between two looks at what other threads do
_OTHERS_SHARE = 0.05  # of a core, which a thread that works goes beyond


class Spinner:
    """What one connection has learnt about its waits.

    Does not look while other Python threads of the process work, as they may need the interpreter's
    lock, nor where it may use one core only, which its peer needs.

    Args:
        budget: the longest time that one wait is spent looking, in seconds; 0: none is.
    """

    def __init__(self, budget: float) -> None:
        self._budget = budget if len(os.sched_getaffinity(0)) > 1 else 0.0
        self._usual_wait = 0.0
        self._rests_until = 0.0
        self._others_used = 0.0  # processor time of the process's other threads
        self._others_looked_at = time.perf_counter()
        self._others_work = True

    def spin(self, watch: Callable[[int], bool]) -> bool:
        """Calls `watch(looks)` until it is true or the budget is spent; returns its last value."""
        if self._usual_wait - _WAKE_UP > self._budget:
            return False
        begin = now = time.perf_counter()
        if now < self._rests_until or self._holds_others_up(now):
            return False
        is_over = False
        while not is_over and now - begin < self._budget:
            if watch(_LOOKS):
                return True
            os.sched_yield()  # the peer may wait for this very core
            last, now = now, time.perf_counter()
            is_over = watch(1)
            if now - last > _LOST_SLICE:
                self._rests_until = now + _RESTS_AFTER_LOSS * (now - last)
                return is_over
        if not is_over:
            self._rests_until = now + _RESTS_IN_VAIN * self._budget
        return is_over

    def learn(self, wait: float) -> None:
        """To be called with the length of each wait, however it was spent."""
        self._usual_wait += (min(wait, _LONGEST_LEARNT) - self._usual_wait) / _MEMORY

    def _holds_others_up(self, now: float) -> bool:
        """Whether other Python threads of this process have worked lately.

        Those of notebooks and progress bars seldom do.
        """
        if threading.active_count() == 1:
            return False
        elapsed = now - self._others_looked_at
        if elapsed > _OTHERS_INTERVAL:
            used = time.process_time() - time.thread_time()
            self._others_work = not 0 <= used - self._others_used < _OTHERS_SHARE * elapsed
            self._others_looked_at, self._others_used = now, used
        return self._others_work
