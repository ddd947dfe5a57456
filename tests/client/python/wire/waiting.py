"""Waiting for what happens in the background, and counting what it leaves behind."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable

PATIENCE_SECONDS = 60  # for a busy machine


def await_true(condition: Callable[[], bool]) -> bool:
    """Whether it becomes true in time."""
    finish = time.monotonic() + PATIENCE_SECONDS
    pause = threading.Event()
    while not condition() and time.monotonic() < finish:
        pause.wait(0.001)
    return condition()


def descriptor_count() -> int:
    """This process's open files. ZeroMQ's threads may open one for a moment, so a test that counts
    them waits until they are few enough."""
    return len(os.listdir("/proc/self/fd"))
