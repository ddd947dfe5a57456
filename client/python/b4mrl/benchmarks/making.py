"""Makes datasets that a daemon's data folder lacks, by the command `b4mrl dataset make`."""

from __future__ import annotations

import subprocess
from pathlib import Path

from b4mrl import errors
from b4mrl.serve import find_server

# What the command's exit codes mean to the caller (proto/base/exit_codes.h); others mean that the
# daemon or the program has failed.
_BAD_USAGE, _BAD_INPUT = 2, 3
_ERRORS: dict[int, tuple[type[errors.B4mrlError], str]] = {
    _BAD_USAGE: (errors.InvalidArgumentError, "refused one of its options"),
    _BAD_INPUT: (
        errors.FailedPreconditionError,
        "cannot make the dataset, or another program makes it at the moment",
    ),
}


def make_dataset(name: str, endpoint: str, rows: int) -> None:
    """Makes a dataset for the daemon at `endpoint`; `rows` 0: as many as published.

    The command's messages and its progress go to stderr.

    Raises:
        UnavailableError: the program b4mrl is not beside the daemon's, or failed.
        FailedPreconditionError: the dataset cannot be made: there is no recipe that can, or a file
            or the data folder cannot be used, or another process makes it just now.
        InvalidArgumentError: no dataset can have so many rows.
    """
    command = [str(Path(find_server()[0]).with_name("b4mrl")), "dataset", "make", name]
    command += ["--endpoint", endpoint]
    if rows > 0:
        command += ["--rows", str(rows)]
    try:
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    except OSError as error:
        raise errors.UnavailableError(f"cannot run {command[0]}: {error}") from None
    if done.returncode != 0:
        kind, what = _ERRORS.get(done.returncode, (errors.UnavailableError, "failed"))
        raise kind(
            f"`{' '.join(command)}` {what} (exit code {done.returncode}); its messages are on "
            "stderr"
        )
