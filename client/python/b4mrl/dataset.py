"""A dataset, possibly corrupted, as the daemon serves it: statistics, random batches, rows."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from b4mrl import errors, query, simulators
from b4mrl.descriptions import DatasetInForce
from b4mrl.display import Record, Shown
from b4mrl.origin import Origin
from b4mrl.simulators import Simulator
from b4mrl.wire import checks, limits
from b4mrl.wire.arrays import Array, require
from b4mrl.wire.connection import Connection
from b4mrl.wire.deliveries import Delivery
from b4mrl.wire.messages import Request
from b4mrl.wire.session import Session

Batch = dict[str, Array]

_READS_IN_FLIGHT = 2  # of one long read: the next one travels while this one is copied


@dataclass(frozen=True, repr=False)
class DatasetStats(Record):
    """Of the data as served.

    Attributes:
        observation_mean, observation_std: (observation size,) float64; population.
        rows, episodes: counts.
        mean_return, std_return, min_return, max_return: of complete episodes, undiscounted.
        min_reward, max_reward: of all rows.
    """

    observation_mean: NDArray[np.float64]
    observation_std: NDArray[np.float64]
    rows: int
    episodes: int
    mean_return: float
    std_return: float
    min_return: float
    max_return: float
    min_reward: float
    max_reward: float


class Dataset(Shown):
    """What Client.dataset returns. A context manager; or close it.

    A batch is a dict of arrays with equal first axes, under D4RL's names: `observations` (rows,
    observation size), `actions` (rows, action size), `rewards` (rows,), `next_observations`, all
    float32, and `terminals` (rows,) bool. Rows that are read in order have `timeouts` (rows,) bool,
    too. NaN and infinity in a file are served as they are.

    Batch b of a seed holds the same rows whoever asks and however often: uniform with replacement,
    a function of (seed, b, number of rows). Thread rule: one thread at a time. In a forked child it
    gets a connection of its own; pickle and copy give a new one, opened by the same arguments.

    Args:
        connection: to the dataset worker; owned by the dataset.
        origin: the arguments that it was opened by.
        deadline_ms: of each request.
        connect: makes another such connection.
        open_queries: opens a session for queries of (environment, simulator); used by pair.

    Attributes:
        name, rows, observation_size, action_size: of the dataset under its transition rule.
        environment: that it was recorded in; "" if neither the file nor its name tells.
        fingerprint: stands for the file's contents, the corruptions and the transition rule.
        in_force: what the daemon has in force.
    """

    def __init__(
        self,
        connection: Connection,
        in_force: DatasetInForce,
        origin: Origin,
        deadline_ms: float,
        connect: Callable[[], Connection],
        open_queries: Callable[[str, str], Session],
    ) -> None:
        self.in_force = in_force
        self.name = in_force.info.name
        self.environment = in_force.environment
        self.fingerprint = in_force.fingerprint
        self.rows = in_force.rows
        self.observation_size = in_force.observation_size
        self.action_size = in_force.action_size
        self._own_connection = connection
        self._origin = origin
        self._deadline_ms = deadline_ms
        self._connect = connect
        self._open_queries = open_queries
        self._next_batch = 0
        self._pairs: dict[tuple[str, int], Batch] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        return (self._origin.open_again, ())

    def _facts(self) -> Mapping[str, Any]:
        return {
            "name": self.name,
            "environment": self.environment,
            "corruption": simulators.text_of(self.in_force.corruptions),
            "rows": self.rows,
            "observation_size": self.observation_size,
            "action_size": self.action_size,
        }

    @property
    def _connection(self) -> Connection:
        if self._own_connection.is_foreign:
            self._own_connection = self._connect()
        return self._own_connection

    def __len__(self) -> int:
        return self.rows

    def __getitem__(self, rows: slice) -> Batch:
        """Rows in the file's order, as a list would give them: dataset[:1000], dataset[-100:]."""
        if not isinstance(rows, slice) or rows.step not in (None, 1):
            raise errors.InvalidArgumentError(
                f"the index is {rows!r}, allowed: a slice of rows without a step, dataset[5:6]; "
                "episodes() has the episodes, stream() random batches"
            )
        first, end, _ = rows.indices(self.rows)
        return self._gather(first, max(end - first, 0))

    def stats(self) -> DatasetStats:
        """Statistics of the data as served, for normalisers and scores."""
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
        self, rows: int, *, seed: int = 0, batch: int | None = None, with_indices: bool = False
    ) -> Batch:
        """One batch of `rows` random rows.

        Args:
            batch: its number. None: the one after that of the last call.
            with_indices: adds `indices` (rows,) uint64, the rows' numbers in the dataset.
        """
        number = self._next_batch if batch is None else checks.unsigned("batch", batch)
        request_id = self._send_sample(rows, seed, number, with_indices)
        result = self._receive_batch(request_id, rows)
        self._next_batch = number + 1
        return result

    def read(self, first_row: int, rows: int) -> Batch:
        """The rows from `first_row` on in the file's order, fewer than `rows` at the end."""
        first_row = checks.unsigned("first_row", first_row)
        if not 0 < checks.unsigned("rows", rows) or first_row >= self.rows:
            raise errors.InvalidArgumentError(
                f"first_row is {first_row} and rows is {rows}, "
                f"allowed: 0..{self.rows - 1} and at least 1"
            )
        return self._gather(first_row, min(rows, self.rows - first_row))

    def load(self) -> Batch:
        """All rows in the file's order, as D4RL's `qlearning_dataset` has them.

        It takes `4 * (2 * observation_size + action_size + 1) + 2` bytes a row.
        """
        return self._gather(0, self.rows)

    def episodes(self) -> Iterator[Batch]:
        """The episodes in the file's order: the rows up to each end, `terminals` or `timeouts`.

        The last one may be unfinished: then its last row has neither.
        """
        rest: list[Batch] = []  # the beginning of the episode that the next part goes on with
        for _, part in self._parts(0, self.rows):
            ends = np.flatnonzero(part["terminals"] | part["timeouts"]) + 1
            first = 0
            for end in ends.tolist():
                rest.append({name: column[first:end] for name, column in part.items()})
                yield _joined(rest)
                rest, first = [], end
            if first < len(part["rewards"]):
                rest.append({name: column[first:] for name, column in part.items()})
        if rest:
            yield _joined(rest)

    def stream(
        self,
        rows: int,
        *,
        seed: int = 0,
        first_batch: int = 0,
        credits: int = 4,
        pair_with: Simulator = None,
        pair_seed: int = 0,
    ) -> Iterator[Batch]:
        """Batches first_batch, first_batch + 1, ... without end.

        Args:
            credits: batches that are asked for ahead, so that the next one is usually here before
                it is wanted.
            pair_with: a simulator, as in Client.make. Each batch then also has what that simulator
                makes of its observations and actions: see pair.
            pair_seed: of the simulator's noise.
        """
        pairs = None if pair_with is None else self.pair(pair_with, seed=pair_seed)
        connection = self._connection
        window = min(max(credits, 1), limits.MAX_REQUESTS_IN_FLIGHT)
        requests: deque[int] = deque()
        number = checks.unsigned("first_batch", first_batch)
        try:
            while True:
                while len(requests) < window:
                    requests.append(self._send_sample(rows, seed, number, pairs is not None))
                    number += 1
                batch = self._receive_batch(requests.popleft(), rows)
                if pairs is not None:
                    indices = batch.pop("indices")
                    batch |= {name: column[indices] for name, column in pairs.items()}
                yield batch
        finally:
            for request_id in requests:
                connection.abandon(request_id)

    def pair(self, simulator: Simulator, *, seed: int = 0) -> Batch:
        """What a simulator makes of every row's observation and action, in the dataset's order.

        `simulator_next_observations` (rows, observation size) float32, `simulator_rewards` (rows,)
        float64, `simulator_terminals` and `simulator_valid` (rows,) bool; a row that is not valid
        holds zeros. The simulator sees the observations as served, so nothing that a corruption
        hides leaks. Noise of row i is that of (seed, draw 0, i). Computed once, at the simulator's
        speed, and kept: 4 bytes a number.

        FailedPreconditionError: it is not known in which environment the dataset was recorded.
        """
        text = simulators.text_of(simulators.parse(simulator))
        key = (text, checks.unsigned("seed", seed))
        if key not in self._pairs:
            self._pairs[key] = self._compute_pairs(text, seed)
        return self._pairs[key]

    def close(self) -> None:
        """Closes the connection; streams end with an error."""
        self._own_connection.close()

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _compute_pairs(self, simulator: str, seed: int) -> Batch:
        if not self.environment:
            raise errors.FailedPreconditionError(
                f"neither the file of the dataset {self.name!r} nor its name tells in which "
                "environment it was recorded; Client.query takes one by name"
            )
        pairs: Batch = {}
        with self._open_queries(self.environment, simulator) as session:
            for first_row, rows in self._parts(0, self.rows):
                asked = query.Rows.of(rows["observations"], rows["actions"])
                answer = query.run(session, asked, seed, 0, first_row)
                names = ("next_observations", "rewards", "terminals", "valid")
                part = {"simulator_" + name: column for name, column in zip(names, answer)}
                _put(pairs, part, first_row, self.rows)
        return pairs

    @functools.cached_property
    def _rows_per_read(self) -> int:
        """As many as fit one reply."""
        row_bytes = 4 * (2 * self.observation_size + self.action_size + 1) + 2
        padding = limits.MAX_ARRAYS_PER_MESSAGE * limits.ARRAY_ALIGNMENT
        fitting = (limits.MAX_PAYLOAD_BYTES - padding) // row_bytes
        return min(limits.MAX_ROWS_PER_BATCH, fitting)

    def _parts(self, first_row: int, rows: int) -> Iterator[tuple[int, Batch]]:
        """(number of its first row, part) of `rows` rows that are there, in order."""
        end = first_row + rows
        connection = self._connection
        under_way: deque[tuple[int, int, int]] = deque()
        try:
            while first_row < end or under_way:
                if first_row < end and len(under_way) < _READS_IN_FLIGHT:
                    count = min(self._rows_per_read, end - first_row)
                    request = Request()
                    request.read.fingerprint = self.fingerprint
                    request.read.first_row = first_row
                    request.read.rows = count
                    request_id = connection.send(request, bytearray(), self._deadline_ms)
                    under_way.append((request_id, first_row, count))
                    first_row += count
                    continue
                request_id, first, count = under_way[0]
                part = self._receive_batch(request_id, count)
                under_way.popleft()
                yield first, part
        finally:
            for request_id, _, _ in under_way:
                connection.abandon(request_id)

    def _gather(self, first_row: int, rows: int) -> Batch:
        if rows == 0:
            return {name: column[:0] for name, column in self._gather(0, 1).items()}
        whole: Batch = {}
        for first, part in self._parts(first_row, rows):
            if len(part["rewards"]) == rows:
                return part
            _put(whole, part, first - first_row, rows)
        return whole

    def _send_sample(self, rows: int, seed: int, batch: int, with_indices: bool) -> int:
        request = Request()
        request.sample.fingerprint = self.fingerprint
        request.sample.seed = checks.unsigned("seed", seed)
        request.sample.first_batch = batch
        request.sample.batches = 1
        request.sample.rows = checks.unsigned("rows", rows, bits=32)
        request.sample.with_indices = with_indices
        return self._connection.send(request, bytearray(), self._deadline_ms)

    def _receive_batch(self, request_id: int, rows: int) -> Batch:
        delivery = self._connection.receive(request_id)
        if delivery.error is not None:
            raise delivery.error
        return self._columns(delivery, rows)

    def _columns(self, delivery: Delivery, rows: int | None) -> Batch:
        found = delivery.arrays
        observations = require(found, "observations", "float32", (rows, self.observation_size))
        n = len(observations)
        batch = {
            "observations": observations,
            "actions": require(found, "actions", "float32", (n, self.action_size)),
            "rewards": require(found, "rewards", "float32", (n,)),
            "next_observations": require(
                found, "next_observations", "float32", (n, self.observation_size)
            ),
            "terminals": require(found, "terminals", "uint8", (n,)).astype(np.bool_),
        }
        if "timeouts" in found:
            batch["timeouts"] = require(found, "timeouts", "uint8", (n,)).astype(np.bool_)
        if "indices" in found:
            batch["indices"] = require(found, "indices", "uint64", (n,))
        return batch


def _put(whole: Batch, part: Batch, position: int, rows: int) -> None:
    """Copies `part` to `position` of `whole`, which gets its columns of `rows` rows by the first."""
    for name, column in part.items():
        if name not in whole:
            whole[name] = np.empty((rows, *column.shape[1:]), column.dtype)
        whole[name][position : position + len(column)] = column


def _joined(parts: list[Batch]) -> Batch:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
