"""A dataset that `b4mrl dataset make` wrote, and its exports, for tests of what reads them."""

from __future__ import annotations

import subprocess
from pathlib import Path

from b4mrl.serve import find_server

NAME = "Hopper/random"  # episodes of some 20 rows, which end by the task's rule
ROWS = 3_000  # the last episode is cut off


def run_dataset(data: Path, *words: str | Path) -> None:
    tools = Path(find_server()[0]).with_name("b4mrl-tools")
    command = [tools, "dataset", *words, "--data", data, "--quiet"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def make_dataset(data: Path) -> Path:
    """Makes NAME in the data folder `data`, and returns its file."""
    run_dataset(data, "make", NAME, "--rows", str(ROWS))
    return data / "Hopper" / "random-v0.h5"
