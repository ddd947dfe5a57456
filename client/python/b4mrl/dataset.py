"""A dataset of the daemon, possibly corrupted: its statistics, random batches and rows."""

from __future__ import annotations

import functools
import itertools
import os
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from b4mrl import errors, pairs, simulators
from b4mrl.descriptions import DatasetInForce, DatasetStats
from b4mrl.display import Shown
from b4mrl.origin import Origin
from b4mrl.simulators import Simulator
from b4mrl.wire import checks, limits
from b4mrl.wire.arrays import Array, episodes_in, put_rows, require, rows_that_fit
from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery
from b4mrl.wire.messages import Request
from b4mrl.wire.pipeline import Resumed, replies_to
from b4mrl.wire.session import Session

Batch = dict[str, Array]

# A long read is cut into replies of at most this size, of which several are under way: over a slow
# link, each has come before its request counts as lost and is sent again. The daemon fills many
# replies up to this size at once, and few larger ones.
_READ_BYTES = 1 << 20
_READS_IN_FLIGHT = 8


class Dataset(Shown):
    """A dataset of the daemon; Client.dataset returns it. Use as a context manager, or close it.

    A batch is a dict of arrays with equal first axes, under D4RL's names: `observations` (rows,
    observation size), `actions` (rows, action size), `rewards` (rows,), `next_observations`, all
    float32, and `terminals` (rows,) bool. Rows that are read in order also have `timeouts` (rows,)
    bool. NaN and infinity in a file are served as they are.

    Rows of random batches are drawn uniformly with replacement, as a function of (seed, number of
    the batch, rows of a batch) alone: every client gets the same rows, however often it asks.

    Thread rule: one thread at a time. In a forked child, a dataset connects anew. pickle and copy
    give a new dataset, opened with the same arguments.

    Args:
        connection: a connection to the dataset worker; owned by the dataset.
        in_force: the daemon's reply to the opening.
        origin: the arguments with which the dataset was opened.
        deadline_ms: time limit of each request, in milliseconds.
        connect: makes another connection to the dataset worker.
        open_queries: opens a session for queries of (environment, simulator); used by pair.
        ledger: its number; counts the rows served, also those requested ahead and never received.

    Attributes:
        name, rows, observation_size, action_size: name and sizes; `rows` counts the rows that the
            transition rule leaves.
        environment: in which it was recorded; "" if neither the file nor its name says.
        corruption: the corruptions in parametric form, "hidden=9+10"; "" without any.
        hidden_dimensions: indices of observations that a corruption hides, or that the behaviour
            policy could not see: 0 in the rows, whatever noise corrupts the others.
        fingerprint: hash of the rows, their environment, the corruptions and the transition rule.
        in_force: the daemon's reply to the opening, with all corruptions in parametric form.
        default_seed: of `sample` and `stream` that are given no seed: 0, or `bench.seed` of the
            benchmark whose dataset this is.
    """

    def __init__(
        self,
        connection: Connection,
        in_force: DatasetInForce,
        origin: Origin,
        deadline_ms: float,
        connect: Callable[[], Connection],
        open_queries: Callable[[str, str], Session],
        ledger: int | None = None,
    ) -> None:
        self.in_force = in_force
        self.name = in_force.info.name
        self.environment = in_force.environment
        self.corruption = simulators.text_of(in_force.corruptions)
        self.hidden_dimensions = in_force.hidden_dimensions
        self.fingerprint = in_force.fingerprint
        self.rows = in_force.rows
        self.observation_size = in_force.observation_size
        self.action_size = in_force.action_size
        self._own_connection = connection
        self._origin = origin
        self._deadline_ms = deadline_ms
        self._connect = connect
        self._open_queries = open_queries
        self._ledger = ledger or 0
        self.default_seed = 0
        self._next_batch = 0
        self._pairs: dict[tuple[str, int, str | None], Batch] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return (self._origin.open_again, (), {"default_seed": self.default_seed})

    def _facts(self) -> Mapping[str, Any]:
        names = "name", "environment", "corruption", "rows", "observation_size", "action_size"
        return {name: getattr(self, name) for name in names}

    @property
    def _connection(self) -> Connection:
        if self._own_connection.is_foreign:
            self._own_connection = self._connect()
        return self._own_connection

    def __len__(self) -> int:
        return self.rows

    def __getitem__(self, rows: slice) -> Batch:
        """The rows of a slice, in the file's order: dataset[:1000], dataset[-100:]."""
        chosen = checks.row_slice(rows, self.rows)
        return self._gather(chosen.start, len(chosen))

    def stats(self) -> DatasetStats:
        """Statistics of the dataset, computed by the daemon."""
        request = Request()
        request.dataset_stats.fingerprint = self.fingerprint
        delivery = self._connection.call(request, bytearray(), self._deadline_ms)
        reply = delivery.reply.dataset_stats
        shape = (self.observation_size,)
        return DatasetStats(
            observation_mean=require(delivery.arrays, "observation_mean", "float64", shape),
            observation_std=require(delivery.arrays, "observation_std", "float64", shape),
            rows=reply.rows,
            episodes=reply.episodes,
            mean_return=reply.mean_return,
            std_return=reply.std_return,
            min_return=reply.min_return,
            max_return=reply.max_return,
            min_reward=reply.min_reward,
            max_reward=reply.max_reward,
        )

    def sample(
        self,
        rows: int,
        *,
        seed: int | None = None,
        batch: int | None = None,
        with_indices: bool = False,
    ) -> Batch:
        """One batch of `rows` random rows.

        Args:
            seed: seed of the random choice, such as bench.seed. None: `default_seed`.
            batch: its number, below 2**64. None: that after the last call's, from 0 on.
            with_indices: adds `indices` (rows,) uint64, the rows' numbers in the dataset.
        """
        rows = checks.integer("rows", rows, 1, limits.MAX_ROWS_PER_BATCH)
        seed = checks.unsigned("seed", self.default_seed if seed is None else seed)
        number = self._next_batch if batch is None else checks.unsigned("batch", batch)
        connection = self._connection
        request_id = self._send_sample(connection, rows, seed, number, with_indices)
        try:
            result = self._columns(connection.reply_to(request_id), rows)
        finally:
            connection.abandon(request_id)  # after Ctrl-C, no other call would receive the reply
        self._next_batch = number + 1
        return result

    def read(self, first_row: int, rows: int) -> Batch:
        """`rows` rows from `first_row` on in the file's order; fewer at the end of the dataset."""
        first_row = checks.integer("first_row", first_row, 0, self.rows - 1)
        rows = checks.integer("rows", rows, 1, None)
        return self._gather(first_row, min(rows, self.rows - first_row))

    def load(self, transitions: str | None = None) -> Batch:
        """All rows in the file's order, under the names of D4RL's `qlearning_dataset`.

        A row takes `4 * (2 * observation_size + action_size + 1) + 2` bytes of memory.

        Args:
            transitions: "stored" for the file's next observations; "d4rl" for the next row's,
                without the rows that end by time-out. None: the rule of the opening.
        """
        if transitions in (None, self.in_force.transition_rule):
            return self._gather(0, self.rows)
        rule = checks.text("transitions", transitions)
        arguments = {**self._origin.arguments, "transition_rule": rule}
        with replace(self._origin, arguments=arguments).open_again() as other:
            hashes = {each.in_force.info.columns_sha256 for each in (self, other)}
            if len(hashes - {""}) > 1:
                raise errors.FailedPreconditionError(
                    f"{self.in_force.info.name} has other rows now than this object; open it again"
                )
            rows: Batch = other.load()
        return rows

    def episodes(self) -> Resumed[Batch]:
        """The episodes in the file's order, each with the rows up to a `terminals` or `timeouts`.

        The last episode may be unfinished: its last row then has neither flag. After an exception,
        such as a deadline's or Ctrl-C, the next call goes on with the episode that it kept back.
        """
        return Resumed(lambda first: episodes_in(self._parts(first, self.rows - first)), 0)

    def stream(
        self,
        rows: int,
        *,
        seed: int | None = None,
        first_batch: int = 0,
        credits: int = 4,
        pair_with: Simulator = None,
        pair_seed: int = 0,
        pair_folder: str | os.PathLike[str] | None = None,
    ) -> Resumed[Batch]:
        """Random batches with the numbers first_batch, first_batch + 1, ..., without end.

        After an exception, such as a deadline's or Ctrl-C, the next call goes on with the batch
        that it kept back.

        Args:
            rows: rows of each batch.
            seed: seed of the random choice, such as bench.seed. None: `default_seed`.
            credits: number of batches requested ahead, so that the next has arrived when it is
                needed. A dataset's streams and long reads, of up to 8, have at most 64 under way.
            pair_with: a simulator, written as in Client.make. Each batch then also has that
                simulator's columns for its rows: see pair, which this calls before it returns.
            pair_seed: seed of the simulator's noise.
            pair_folder: where that simulator's columns are kept; None: in memory.
        """
        rows = checks.integer("rows", rows, 1, limits.MAX_ROWS_PER_BATCH)
        seed = checks.unsigned("seed", self.default_seed if seed is None else seed)
        first_batch = checks.unsigned("first_batch", first_batch)
        credits = checks.integer("credits", credits, 0, None)
        pair = pair_with, pair_seed, pair_folder, "pair_"
        paired = None if pair_with is None else self._paired(*pair)
        return Resumed(functools.partial(self._batches, rows, seed, credits, paired), first_batch)

    def _batches(
        self, rows: int, seed: int, credits: int, paired: Batch | None, first_batch: int
    ) -> Generator[tuple[Batch, int], None, None]:
        """Yields batches, each with the number of the next one."""
        connection = self._connection
        sent = (
            self._send_sample(connection, rows, seed, number, paired is not None)
            for number in itertools.count(first_batch)
        )
        window = min(max(credits, 1), limits.MAX_REQUESTS_IN_FLIGHT)
        for behind, delivery in enumerate(replies_to(connection, sent, window), first_batch + 1):
            batch = self._columns(delivery, rows)
            if paired is not None:
                indices = batch.pop("indices")
                batch |= {name: column[indices] for name, column in paired.items()}
            yield batch, behind

    def pair(
        self, simulator: Simulator, *, seed: int = 0, folder: str | os.PathLike[str] | None = None
    ) -> Batch:
        """Simulates one step from every row's observation and action; columns in the file's order.

        The columns are `simulator_next_observations` (rows, observation size) float32,
        `simulator_rewards` (rows,) float64, `simulator_terminals` and `simulator_valid` (rows,)
        bool; a row that is not valid holds zeros. The simulator starts from the observations as
        served, so it reveals nothing that a corruption hides. The noise of row i is that of
        Client.query with `seed`, draw 0 and row number i. The first call simulates all rows; the
        dataset keeps the columns for its streams and later calls, so they are read-only.

        Args:
            folder: keeps the columns on disk as well, for later runs of any process, under a name
                made of the identities of dataset, simulator and seed; made if it is missing. The
                columns are then mapped from the files and take no memory of their own.

        FailedPreconditionError: the environment in which the dataset was recorded is not known.
        DataLossError: a file of the folder is damaged.
        """
        kept = self._paired(simulator, seed, folder)
        return {name: column.view() for name, column in kept.items()}

    @property
    def is_closed(self) -> bool:
        """Whether close was called."""
        return not (self._own_connection.is_usable or self._own_connection.is_foreign)

    def close(self) -> None:
        """Closes the connection; streams that are still read raise an error."""
        self._own_connection.close()

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _paired(self, simulator: Simulator, seed: int, folder: Any, prefix: str = "") -> Batch:
        """The kept columns of pair; not the caller's to change.

        `prefix` begins the names of seed and folder where the caller gave them.
        """
        text = simulators.text_of(
            simulators.parse(simulator, f"{prefix}with" if prefix else "simulator")
        )
        if folder is not None:
            folder = os.path.abspath(checks.path(f"{prefix}folder", folder))
        key = (text, checks.unsigned(f"{prefix}seed", seed), folder)
        if key not in self._pairs:
            self._pairs[key] = self._find_pairs(*key)
        return self._pairs[key]

    def _find_pairs(self, simulator: str, seed: int, folder: str | None) -> Batch:
        if not self.environment:
            raise errors.FailedPreconditionError(
                f"neither the file of the dataset {self.name!r} nor its name says in which "
                "environment it was recorded; use Client.query, which takes the environment's name"
            )
        with self._open_queries(self.environment, simulator) as session:
            simulate = functools.partial(
                pairs.simulate, session, self._parts(0, self.rows), self.rows, seed
            )
            if folder is None:
                return simulate()
            experiment = session.in_force.experiment_id
            kept = Path(folder) / pairs.name_of(self.fingerprint, experiment, seed)
            if not kept.is_dir():
                kept.parent.mkdir(parents=True, exist_ok=True)  # fails before rows are simulated
                pairs.write(kept, simulate())
        return pairs.read(kept, self.rows, self.observation_size)

    @functools.cached_property
    def _rows_per_read(self) -> int:
        """The number of rows in one reply to a long read."""
        row_bytes = 4 * (2 * self.observation_size + self.action_size + 1) + 2
        return min(limits.MAX_ROWS_PER_BATCH, rows_that_fit(row_bytes, _READ_BYTES))

    def _parts(self, first_row: int, rows: int) -> Generator[tuple[int, Batch], None, None]:
        """Yields the `rows` existing rows in order, in parts: (number of its first row, part)."""
        connection = self._connection
        end, step = first_row + rows, self._rows_per_read
        parts = [range(first, min(first + step, end)) for first in range(first_row, end, step)]
        sent = (self._send_read(connection, part) for part in parts)
        for part, delivery in zip(parts, replies_to(connection, sent, _READS_IN_FLIGHT)):
            yield part.start, self._columns(delivery, len(part))

    def _send_read(self, connection: Connection, rows: range) -> int:
        request = Request()
        request.read.fingerprint = self.fingerprint
        request.read.first_row = rows.start
        request.read.rows = len(rows)
        request.read.ledger = self._ledger
        return connection.send(request, bytearray(), self._deadline_ms)

    def _gather(self, first_row: int, rows: int) -> Batch:
        if rows == 0:
            return self._no_rows()
        whole: Batch = {}
        for first, part in self._parts(first_row, rows):
            if len(part["rewards"]) == rows:
                return part
            put_rows(whole, part, first - first_row, rows)
        return whole

    def _no_rows(self) -> Batch:
        """A batch of no rows, which asks the daemon for nothing."""
        shapes = self._shapes(0).items()
        batch: Batch = {name: np.empty(shape, np.float32) for name, shape in shapes}
        return batch | {name: np.empty(0, np.bool_) for name in ("terminals", "timeouts")}

    def _shapes(self, rows: int) -> dict[str, tuple[int, ...]]:
        """The shapes of `rows` rows of each column but the flags."""
        states = rows, self.observation_size
        return {
            "observations": states,
            "actions": (rows, self.action_size),
            "rewards": (rows,),
            "next_observations": states,
        }

    def _send_sample(
        self, connection: Connection, rows: int, seed: int, batch: int, with_indices: bool
    ) -> int:
        request = Request()
        request.sample.fingerprint = self.fingerprint
        request.sample.seed = seed
        request.sample.first_batch = checks.unsigned("batch", batch)
        request.sample.batches = 1
        request.sample.rows = rows
        request.sample.with_indices = with_indices
        request.sample.ledger = self._ledger
        return connection.send(request, bytearray(), self._deadline_ms)

    def _columns(self, delivery: Delivery, n: int) -> Batch:
        found = delivery.arrays
        shapes = self._shapes(n).items()
        batch = {name: require(found, name, "float32", shape) for name, shape in shapes}
        batch["terminals"] = require(found, "terminals", "uint8", (n,)).astype(np.bool_)
        if "timeouts" in found:
            batch["timeouts"] = require(found, "timeouts", "uint8", (n,)).astype(np.bool_)
        if "indices" in found:
            batch["indices"] = require(found, "indices", "uint64", (n,))
        return batch
