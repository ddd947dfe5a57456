"""Makes datasets that a daemon's data folder lacks, by the command `b4mrl dataset make`."""

from __future__ import annotations

import subprocess
from pathlib import Path

from b4mrl.errors import UnavailableError
from b4mrl.serve import find_server


def make_dataset(name: str, endpoint: str, rows: int) -> None:
    """Makes a dataset for the daemon at `endpoint`; `rows` 0: as many as published.

    The command's messages and its progress go to stderr. UnavailableError: the program b4mrl is not
    beside the daemon's, or failed.
    """
    command = [str(Path(find_server()[0]).with_name("b4mrl")), "dataset", "make", name]
    command += ["--endpoint", endpoint]
    if rows > 0:
        command += ["--rows", str(rows)]
    try:
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    except OSError as error:
        raise UnavailableError(f"cannot run {command[0]}: {error}") from None
    if done.returncode != 0:
        raise UnavailableError(
            f"`{' '.join(command)}` failed with exit code {done.returncode}; its messages are on "
            "stderr"
        )
