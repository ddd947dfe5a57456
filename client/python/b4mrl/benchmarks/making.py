"""Makes datasets that a daemon's data folder lacks, by the command `b4mrl dataset make`.

Also says what is known of a dataset before it is made, and where one that was there is another.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from b4mrl import errors
from b4mrl.dataset import Dataset
from b4mrl.descriptions import DatasetInForce
from b4mrl.serve import find_server

# What the command's exit codes mean to the caller (proto/base/exit_codes.h); others mean that the
# daemon or the program has failed.
_FAILED, _BAD_USAGE, _BAD_INPUT, _BUSY = 1, 2, 3, 6
_ERRORS: dict[int, tuple[type[errors.B4mrlError], str]] = {
    _FAILED: (errors.DataLossError, "failed, or has made other rows than the published ones"),
    _BAD_USAGE: (errors.InvalidArgumentError, "refused one of its options"),
    _BAD_INPUT: (errors.FailedPreconditionError, "cannot make the dataset"),
    _BUSY: (errors.BusyError, "found another program at work on the dataset"),
}

_PATIENCE_S = 3600.0  # for a dataset that another program makes, which takes minutes at most
_POLL_S = 1.0

# The recipes (algorithms/datasets/dataset_recipes.cc) whose behaviour policies see everything:
# all but HalfCheetah/partial-*.
_LEVELS = ("random", "medium", "medium-replay", "expert", "medium-expert")
_COMPLETE = {
    f"{task}/{level}" for task in ("HalfCheetah", "Hopper", "Walker2d") for level in _LEVELS
}
_COMPLETE |= {f"HalfCheetah/{level}" for level in ("late-expert", "medium-late-expert")}
_COMPLETE |= {"HalfCheetah/action-delay", "Highway/random", "Highway/medium"}

# Options of the command that change a recipe; --agent makes datasets that have none, too.
_CHANGES = ("--rows", "--seed", "--simulator")


def open_or_make(
    open_it: Callable[[], Dataset], name: str, endpoint: str, rows: int | None
) -> Dataset:
    """`open_it()`, after the dataset was made if it is missing.

    Waits while another program makes it. RuntimeWarning: what was made here is not the published
    dataset; it is opened all the same.

    Args:
        rows: as for make_dataset, whose errors this raises. None: none is made.

    UnknownNameError: the dataset is missing, and `rows` is None.
    """
    try:
        return open_it()
    except errors.UnknownNameError:
        if rows is None:
            raise
    end = time.monotonic() + _PATIENCE_S
    while True:
        failure: errors.B4mrlError | None = None
        try:
            make_dataset(name, endpoint, rows)
        except errors.B4mrlError as error:
            failure = error
        try:
            dataset = open_it()  # which another program may have made
        except errors.UnknownNameError:
            if failure is None:
                raise
        else:
            if isinstance(failure, errors.DataLossError):
                errors.warn(f"{failure}; it is used as it is")
            return dataset
        if not isinstance(failure, errors.BusyError) or time.monotonic() > end:
            raise failure
        time.sleep(_POLL_S)


def make_dataset(name: str, endpoint: str, rows: int) -> None:
    """Makes a dataset for the daemon at `endpoint`; `rows` 0: as many as published.

    The command's messages and its progress go to stderr.

    Raises:
        UnknownNameError: the program b4mrl is not beside the daemon's here, so the dataset has to
            be made elsewhere.
        UnavailableError: the daemon or the program failed.
        DataLossError: the program failed, or has made other rows than the published ones.
        BusyError: another process makes it at the moment, or has just made it.
        FailedPreconditionError: the dataset cannot be made: there is no recipe that can, or a file
            or the data folder cannot be used.
        InvalidArgumentError: no dataset can have so many rows.
    """
    words = ["dataset", "make", name]
    if rows > 0:
        words += ["--rows", str(rows)]
    try:
        command = [str(Path(find_server()[0]).with_name("b4mrl")), *words, "--endpoint", endpoint]
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    except (OSError, errors.UnavailableError) as error:
        raise errors.UnknownNameError(
            f"the daemon at {endpoint} lacks the dataset {name!r}; run `b4mrl {' '.join(words)}` "
            f"on its machine, as it cannot be made from here ({error})"
        ) from error
    if done.returncode != 0:
        kind, what = _ERRORS.get(done.returncode, (errors.UnavailableError, "failed"))
        raise kind(
            f"`{' '.join(command)}` {what} (exit code {done.returncode}); its messages are on "
            "stderr"
        )


def records_everything(name: str) -> bool:
    """Whether a dataset that is made by the name's recipe shows every dimension uncorrupted."""
    return errors.without_version(name) in _COMPLETE


def warn_of_other_rows(name: str, found: DatasetInForce, asked: int) -> None:
    """RuntimeWarning: the dataset of that name has other rows than `make_dataset` would give it.

    Args:
        name: of the dataset, as the benchmark has it.
        found: the dataset that the daemon has.
        asked: number of rows; 0: those that are published. Which these are is not known here, but
            the file has the command that made it, and that has options where it changed the recipe.
    """
    has, again = f"the dataset {name} has {found.info.rows} rows", f"`b4mrl dataset make {name}"
    command = f"{found.provenance.command} "
    changes = [option for option in _CHANGES if f" {option} " in command]
    if asked > 0 and found.info.rows != asked:
        text = (
            f"{has} and is used as it is: rows={asked} counts only where a dataset is missing; "
            f"{again} --replace --rows {asked}` makes it anew"
        )
    elif asked == 0 and changes and " --agent " not in command:
        text = (
            f"{has} and was made with {', '.join(changes)}, so it need not be the published one, "
            f"which rows=0 asks for; {again} --replace` makes that"
        )
    else:
        return
    errors.warn(text)
