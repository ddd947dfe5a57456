"""A dataset, possibly corrupted, as the daemon serves it: statistics, random batches, rows."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from b4mrl import checks, errors, limits
from b4mrl.arrays import Array, require
from b4mrl.connection import Connection, Delivery
from b4mrl.messages import Request

if TYPE_CHECKING:
    from b4mrl.client import Client

Batch = dict[str, Array]

_READ_ROWS = 65536  # of one request while a dataset is paired


@dataclass(frozen=True)
class DatasetStats:
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


class Dataset:
    """What Client.dataset returns. A context manager; or close it.

    A batch is a dict of arrays with equal first axes: `observations` (rows, observation size),
    `actions` (rows, action size), `rewards` (rows,), `next_observations`, all float32, and
    `terminals` (rows,) bool. NaN and infinity in a file are served as they are.

    Batch b of a seed holds the same rows whoever asks and however often: uniform with replacement,
    a function of (seed, b, number of rows). Thread rule: one thread at a time.

    Attributes:
        name, rows, observation_size, action_size: of the dataset under its transition rule.
        fingerprint: stands for the file's contents, the corruptions and the transition rule.
        in_force: the message OpenDatasetReply of b4mrl.proto.
    """

    def __init__(
        self, connection: Connection, in_force: Any, client: Client, deadline_ms: float
    ) -> None:
        self.in_force = in_force
        self.name: str = in_force.info.name
        self.fingerprint: str = in_force.fingerprint
        self.rows: int = in_force.rows
        self.observation_size: int = in_force.observation_size
        self.action_size: int = in_force.action_size
        self._connection = connection
        self._client = client
        self._deadline_ms = deadline_ms
        self._next_batch = 0
        self._pairs: dict[tuple[str, int], Batch] = {}

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
        """The rows from `first_row` on in the file's order, fewer than `rows` at the end.

        They come with `timeouts` (rows,) bool.
        """
        request = Request()
        request.read.fingerprint = self.fingerprint
        request.read.first_row = checks.unsigned("first_row", first_row)
        request.read.rows = checks.unsigned("rows", rows, bits=32)
        return self._columns(self._connection.call(request, bytearray(), self._deadline_ms), None)

    def stream(
        self,
        rows: int,
        *,
        seed: int = 0,
        first_batch: int = 0,
        credits: int = 4,
        pair_with: str | None = None,
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
                self._connection.abandon(request_id)

    def pair(self, simulator: str, *, seed: int = 0) -> Batch:
        """What a simulator makes of every row's observation and action, in the dataset's order.

        `simulator_next_observations` (rows, observation size) float32, `simulator_rewards` (rows,)
        float64, `simulator_terminals` and `simulator_valid` (rows,) bool; a row that is not valid
        holds zeros. The simulator sees the observations as served, so nothing that a corruption
        hides leaks. Noise of row i is that of (seed, draw 0, i). Computed once, at the simulator's
        speed, and kept: 4 bytes a number.
        """
        key = (simulator, seed)
        if key not in self._pairs:
            self._pairs[key] = self._compute_pairs(simulator, seed)
        return self._pairs[key]

    def close(self) -> None:
        """Closes the connection; streams end with an error."""
        self._connection.close()

    def __enter__(self) -> Dataset:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _environment(self, client: Client) -> str:
        """Where it was recorded, from "HalfCheetah/medium" or "d4rl/halfcheetah-medium-v2"."""
        folder, _, rest = self.name.partition("/")
        wanted = (folder.lower(), rest.partition("-")[0].lower())
        for environment in client.environments():
            if environment.lower() in wanted:
                return environment
        raise errors.UnknownNameError(f"no environment is known for the dataset {self.name!r}")

    def _compute_pairs(self, simulator: str, seed: int) -> Batch:
        parts = []
        with copy(self._client) as client:  # the original may be another thread's, or closed
            environment = self._environment(client)
            for first_row in range(0, self.rows, _READ_ROWS):
                rows = self.read(first_row, min(_READ_ROWS, self.rows - first_row))
                parts.append(
                    client.query(
                        environment,
                        rows["observations"],
                        rows["actions"],
                        simulator,
                        seed=seed,
                        first_row=first_row,
                    )
                )
        names = ("next_observations", "rewards", "terminals", "valid")
        return {
            "simulator_" + name: np.concatenate(columns)
            for name, columns in zip(names, zip(*parts))
        }

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
