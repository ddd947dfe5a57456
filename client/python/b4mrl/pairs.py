"""Pairs of a dataset's rows with a simulator's outcomes (Dataset.pair), in memory or on disk.

On disk, a folder holds the pairs of any number of datasets and simulators: each in a folder of its
own, named by their identities, with one `.npy` file a column. It appears complete or not at all, so
several processes may use one folder at once.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import shutil
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from b4mrl import errors, query
from b4mrl.wire.arrays import Array
from b4mrl.wire.session import QueryAnswer, Session

# Columns of a pairing and their dtypes, in the order of a query's answer.
_DTYPES = {
    "simulator_next_observations": "float32",
    "simulator_rewards": "float64",
    "simulator_terminals": "bool",
    "simulator_valid": "bool",
}


def _shape(name: str, rows: int, observation_size: int) -> tuple[int, ...]:
    return (rows, observation_size) if name == "simulator_next_observations" else (rows,)


def simulate(
    session: Session,
    parts: Iterable[tuple[int, Mapping[str, Array]]],
    rows: int,
    seed: int,
) -> dict[str, Array]:
    """The columns of all `rows` rows, which come in `parts`: (number of the first row, rows).

    They are read-only, as those of `read` are.
    """
    size = session.spec.observation.size
    pairs = {name: np.empty(_shape(name, rows, size), dtype) for name, dtype in _DTYPES.items()}
    for first_row, answer in _answers(session, parts, seed):
        for whole, column in zip(pairs.values(), answer):
            whole[first_row : first_row + len(column)] = column
    for column in pairs.values():
        column.flags.writeable = False  # also of the views that callers get
    return pairs


def _answers(
    session: Session, parts: Iterable[tuple[int, Mapping[str, Array]]], seed: int
) -> Iterator[tuple[int, QueryAnswer]]:
    """Each part's first row and its answer; the next part is being simulated meanwhile."""
    under_way: deque[tuple[int, Callable[[], QueryAnswer]]] = deque()
    for first_row, part in parts:
        asked = query.Rows.of(part["observations"], part["actions"])
        under_way.append((first_row, query.begin(session, asked, seed, 0, first_row)))
        if len(under_way) > 1:
            earlier, gather = under_way.popleft()
            yield earlier, gather()
    for first_row, gather in under_way:
        yield first_row, gather()


def name_of(fingerprint: str, experiment_id: str, seed: int) -> str:
    """The name of the folder of the pairs of a dataset, a query session and a seed of its noise."""
    identity = json.dumps([fingerprint, experiment_id, seed])
    return hashlib.sha256(identity.encode()).hexdigest()[:32]


def read(folder: Path, rows: int, observation_size: int) -> dict[str, Array]:
    """Maps the columns of a folder that `write` made, read-only.

    DataLossError: the folder's files are not those columns.
    """
    found: dict[str, Array] = {}
    for name, dtype in _DTYPES.items():
        path, shape = folder / f"{name}.npy", _shape(name, rows, observation_size)
        try:
            column = np.asarray(np.load(path, mmap_mode="r", allow_pickle=False))
        except (OSError, ValueError, EOFError) as error:
            raise errors.DataLossError(f"{path}: {error}; remove the folder {folder}") from error
        if (column.dtype, column.shape) != (np.dtype(dtype), shape):
            raise errors.DataLossError(
                f"{path} holds {column.dtype} of shape {column.shape}, allowed: {dtype} of shape "
                f"{shape}; remove the folder {folder}"
            )
        found[name] = column
    return found


def write(folder: Path, columns: Mapping[str, Array]) -> None:
    """Makes the folder of the columns; keeps one that another process has made meanwhile."""
    unfinished = folder.with_name(f"{folder.name}.{secrets.token_hex(8)}")
    unfinished.mkdir(parents=True)
    try:
        for name, column in columns.items():
            with open(unfinished / f"{name}.npy", "wb") as file:
                np.save(file, column, allow_pickle=False)
                file.flush()
                os.fsync(file.fileno())
        try:
            unfinished.rename(folder)
        except OSError:
            if not folder.is_dir():
                raise
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
