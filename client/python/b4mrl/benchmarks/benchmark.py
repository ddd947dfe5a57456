"""A benchmark as one object: its two flawed sources of experience, its evaluation, its results."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from b4mrl import simulators
from b4mrl.benchmarks import evaluation, making, recording, result_file
from b4mrl.benchmarks.curve import Curve
from b4mrl.benchmarks.evaluation import Evaluation, PolicyLike
from b4mrl.benchmarks.folders import folder_of_results
from b4mrl.benchmarks.ledger import Ledger
from b4mrl.benchmarks.recording import Recording, Use
from b4mrl.benchmarks.result_file import Result
from b4mrl.benchmarks.usage import Usage
from b4mrl.dataset import Dataset
from b4mrl.descriptions import BenchmarkInfo
from b4mrl.display import Shown
from b4mrl.errors import InvalidArgumentError, UnknownNameError
from b4mrl.query import PendingQuery
from b4mrl.simulators import NamedArgument
from b4mrl.spec import EnvironmentSpec
from b4mrl.vector_environment import VectorEnvironment
from b4mrl.wire import checks, limits
from b4mrl.wire.session import QueryAnswer

if TYPE_CHECKING:  # whose method `benchmark` makes these objects
    from b4mrl.client import Client

_HELD_OUT_SEED = 1  # of evaluations on other starts than those of the evaluations during training
_OBSERVE = ("trained", "full", "served")


class Benchmark(Shown):
    """One benchmark of the catalogue; Client.benchmark and b4mrl.benchmark return it.

    Thread rule: one thread at a time; it uses its client.

    Args:
        client: of the daemon that hosts simulator and dataset.
        info: the catalogue's entry.
        make_rows: makes the dataset if the daemon's data folder lacks it, with so many rows; 0: as
            published. A RuntimeWarning says where there is one with other rows. None: a missing
            dataset is an error.
        ledger: number of the daemon's ledger in which learning counts; 0: a new one.

    Attributes:
        info: what the benchmark is made of; name, environment and paper are taken from it.
        name: "HalfCheetah/confounding/hidden-high+medium-expert".
        environment: "HalfCheetah".
        paper: the paper's scores by algorithm: (mean, standard deviation) of three seeds.
        seed, updates, out: in a program that `b4mrl benchmark run --learner` has started: the run's
            seed, its number of updates, and the folder in which the program leaves agent.h5 or
            returns.json; else 0, None and None. Batches, simulators and queries that are given no
            seed take the run's; a learner's own random numbers have to follow it, too.
    """

    def __init__(
        self,
        client: Client,
        info: BenchmarkInfo,
        *,
        make_rows: int | None = None,
        seed: int = 0,
        updates: int | None = None,
        out: Path | None = None,
        ledger: int = 0,
    ) -> None:
        self.info = info
        self.name = info.name
        self.environment = info.environment
        self.paper = info.paper
        self._client = client
        self._make_rows = make_rows
        self.seed = seed
        self.updates = updates
        self.out = out
        self._usage = Usage(client, ledger)
        self._opened: tuple[Ledger, Dataset] | None = None  # the dataset, and who counts its rows
        self._next_draw = 0  # of queries without a draw of their own
        self._curves: dict[int, Curve] = {}  # by seed, since its last result

    def _facts(self) -> Mapping[str, Any]:
        names = ("name", "simulator", "dataset", "corruption", "world")
        return {name: getattr(self.info, name) for name in names}

    @property
    def dataset(self) -> Dataset | Any:  # Any: a type checker lets a learner that needs one go on
        """The corrupted dataset, opened at the first use; None for a benchmark without one.

        One that was closed is opened again. FailedPreconditionError: no recipe can make it here.
        UnknownNameError: the daemon's data folder lacks it; `b4mrl dataset make` makes it.
        """
        dataset = self._dataset
        self._usage.begin()  # only now: that the dataset was made is no part of a learner's time
        return dataset

    @property
    def _dataset(self) -> Dataset | None:
        """The dataset, opened once a ledger; None for a benchmark without one."""
        if not self.info.dataset:
            return None
        ledger = self._usage.learning
        if self._opened is None or self._opened[0] is not ledger or self._opened[1].is_closed:
            self._opened = ledger, self._open_dataset(ledger, self._make_rows)
        return self._opened[1]

    def _open_dataset(self, ledger: Ledger | None, make_rows: int | None) -> Dataset:
        """UnknownNameError: the dataset is missing, and `make_rows` is None."""
        names = self.info.dataset, self.info.corruption
        options: dict[str, Any] = {"environment": self.environment, "ledger": ledger}
        open_it = functools.partial(self._client.dataset, *names, **options)
        dataset = making.open_or_make(open_it, names[0], self._client.endpoint, make_rows)
        # The runner's datasets have the rows of its budget, so rows=0 asks for nothing there.
        if self._make_rows is not None and (self._make_rows > 0 or self.out is None):
            making.warn_of_other_rows(names[0], dataset.in_force, self._make_rows)
        dataset.default_seed = self.seed
        return dataset

    def make_simulator(self, num_envs: int = 1, **options: Any) -> VectorEnvironment:
        """`num_envs` environments of the flawed simulator; `options` are those of make_vec.

        InvalidArgumentError: they hold `simulator` or `ledger`, of which the benchmark has its own.
        Without a `seed`, they have those of the run, seed, seed + 1, ..., in a program that `b4mrl
        benchmark run --learner` has started; elsewhere the daemon draws one: give seed=bench.seed.
        """
        for name in {"simulator", "ledger"} & options.keys():
            raise InvalidArgumentError(f"{name} is given, but the benchmark has its own")
        self._usage.begin()
        ledger = self._usage.learning
        if self.out is not None:
            options = {"seed": self.seed} | options
        return self._client.make_vec(
            self.environment, num_envs, self.info.simulator, ledger=ledger, **options
        )

    def query(
        self,
        observations: ArrayLike,
        actions: ArrayLike,
        *,
        seed: int | None = None,
        draw: int | None = None,
        first_row: int = 0,
    ) -> QueryAnswer:
        """One step of the flawed simulator from each row, as Client.query returns it.

        Without a `draw`, the object's queries have the draws 0, 1, 2, ...: each its own noise.
        Without a `seed`, theirs is `bench.seed`.
        """
        return self.query_async(
            observations, actions, seed=seed, draw=draw, first_row=first_row
        ).result()

    def query_async(
        self,
        observations: ArrayLike,
        actions: ArrayLike,
        *,
        seed: int | None = None,
        draw: int | None = None,
        first_row: int = 0,
    ) -> PendingQuery:
        """As query, but does not wait: `query_async(...).result()` has the answer."""
        self._usage.begin()
        pending = self._client.query_async(
            self.environment,
            observations,
            actions,
            self.info.simulator,
            seed=self.seed if seed is None else seed,
            draw=self._next_draw if draw is None else draw,
            first_row=first_row,
            ledger=self._usage.learning,
        )
        if draw is None:
            self._next_draw += 1
        return pending

    @functools.cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Which dimensions of an observation a policy may see in evaluations; False: it sees 0.

        Read-only, of the observation's shape.
        Hidden is what its training hid: dimensions that the dataset hides or that its behaviour
        policy could not see; in a benchmark without a dataset, those that the simulator hides. A
        learner of a full dataset and a simulator that hides dimensions may see all of them.

        Opens the dataset, which knows what its behaviour policy could not see. One that is missing
        is not made for that if its recipe hides nothing; those of HalfCheetah/partial-* do.
        UnknownNameError: the dataset is missing, and may hide something.
        """
        space = self._spec.observation
        is_plain = making.records_everything(self.info.dataset)
        hidden = evaluation.hidden_by(self._seen_through, space)
        if self._opened is not None:
            hidden = evaluation.hidden_in(self._opened[1], space)
        elif self.info.dataset:
            with contextlib.suppress(UnknownNameError if is_plain else ()):
                # No rows are served, so no ledger is taken.
                with self._open_dataset(None, None if is_plain else self._make_rows) as dataset:
                    hidden = evaluation.hidden_in(dataset, space)
        seen = np.ones(space.size, np.bool_)
        seen[hidden] = False
        seen.flags.writeable = False  # evaluations use this array, too
        return seen.reshape(space.shape)

    def evaluate(
        self,
        policy: PolicyLike,
        episodes: int = 10,
        *,
        held_out: bool = False,
        observe: str = "trained",
    ) -> Evaluation:
        """The score of a policy in the benchmark's world: the true environment, if not said else.

        Args:
            policy: a function from observations to actions, float32 and without exploration, or
                the file of an agent. It is called with a batch (episodes, *shape). If it raises an
                error then or returns no (episodes, *action shape), it is called with one
                observation at a time, and plays one episode after the other. In a batch, row i
                belongs to episode i. A method `reset`, if it has one, is called before episodes.
            episodes: their number, 1 to 1,024; they start as those of `b4mrl evaluate` do.
            held_out: other starts than those of the evaluations during training (seed 1 of `b4mrl
                evaluate`, else 0).
            observe: "trained" sets what `mask` hides to 0; "full" hides nothing; "served" is
                "trained" with the noise that the training's observations had.

        InvalidArgumentError: `observe` is "served", and the training has no noise. Else as `mask`,
        which may have to make the dataset.
        """
        episodes = checks.integer("episodes", episodes, 1, limits.MAX_LANES_PER_SESSION)
        if observe not in _OBSERVE:
            raise InvalidArgumentError(f"observe is {observe!r}, allowed: {', '.join(_OBSERVE)}")
        if observe == "served" and not self._noise:
            raise InvalidArgumentError(
                f"observe is 'served', allowed: trained, full; {self.name} trains without noise"
            )
        act = evaluation.policy_of(policy, self.environment, unmasked=observe == "full")
        mask = np.ones_like(self.mask) if observe == "full" else self.mask
        world = self._world(observe)
        with self._client.make_vec(
            self.environment, episodes, world, seed=0, autoreset_mode="disabled"
        ) as vec:
            return evaluation.play(vec, act, mask, _HELD_OUT_SEED if held_out else 0)

    def log(
        self,
        seed: int,
        updates: int,
        policy: PolicyLike,
        episodes: int = 10,
        *,
        algorithm: str | None = None,
    ) -> Evaluation:
        """Evaluates a policy, and appends a point to the curve of the next result of `seed`.

        Points at `updates` and beyond are dropped: the run has begun again from an earlier update.

        Args:
            algorithm: the name that `record` will be given; one that it would refuse is refused
                here, before it has cost a training. None: it is not checked.
        """
        if algorithm is not None:
            result_file.check_algorithm(algorithm, self.info)
        seed, updates = checks.unsigned("seed", seed), checks.unsigned("updates", updates)
        scores = self.evaluate(policy, episodes)
        self._append(seed, updates, scores.returns)
        return scores

    def record(
        self,
        policy: PolicyLike | None = None,
        *,
        algorithm: str,
        seed: int,
        updates: int,
        folder: str | os.PathLike[str],
        returns: ArrayLike | None = None,
        episodes: int = 10,
        hyperparameters: Mapping[str, Any] | None = None,
    ) -> Path:
        """Writes a result into `folder`, as `b4mrl benchmark run` does, and returns its file.

        The policy is evaluated as it observes in training and, where the training hid dimensions
        or had noise, also in full or through the noise. The curve has the points of `log`. The
        ledger has what the daemon has counted since the benchmark's last result, and the number of
        episodes that stand behind the curve, whose last point is the result's own returns. If
        nothing was used or logged since then and the file is that of the same updates, as when a
        notebook's cell is executed once more, ledger, time and curve are the file's. The time is
        that since the last result, or since a source was first used and its dataset was there; this
        call's scoring is not in it. The dataset is opened, or made, as the result names its rows.

        The file names no budget, which would say that `b4mrl evaluate` has scored the run to the
        last bit: the policy acts here by NumPy or PyTorch, so `b4mrl benchmark check` compares its
        mean return with that of the agent's episodes (benchmarks/RULES.md).

        Args:
            policy: the policy after the last update, as for `evaluate`.
            algorithm: the name under which reports show it: 1 to 40 letters (A to Z, a to z),
                digits and dashes, but none of B4MRL's own algorithms, in capital or small letters.
                `log` can check it early.
            seed, updates: of the run.
            folder: made if it is missing; a result of the same run in it is replaced, unless it has
                more updates. In a runner's folder, which keeps its results in a subfolder
                `results`, the file is written there, where `results` and `b4mrl report` look.
            returns: in place of a policy, the returns of episodes in the benchmark's world, which
                the caller has evaluated; the result is marked as self-scored.
            hyperparameters: numbers and texts, for the reader of the result.

        InvalidArgumentError: the name is none of those, or the benchmark is not defined for it
        (info.is_defined_for), or both or none of policy and returns are given.
        FailedPreconditionError: the folder has a result of more updates.
        """
        result_file.check_algorithm(algorithm, self.info)
        plain = result_file.plain_hyperparameters(hyperparameters)
        seed, updates = checks.unsigned("seed", seed), checks.unsigned("updates", updates)
        place = folder_of_results(checks.path("folder", folder))
        recording.check_source(policy, returns)
        seconds = self._usage.seconds()  # before the scoring, which is no part of the training
        dataset = None if self._dataset is None else self._dataset.in_force
        result = Recording(self.info, algorithm, seed, updates, place, dataset)
        reached = evaluation.given_returns(returns)
        place.mkdir(parents=True, exist_ok=True)  # fails before the policy is evaluated
        scorings: dict[str, Any] = {}
        if policy is not None:
            reached = self.evaluate(policy, episodes).returns
            scorings = self._scorings(policy, episodes)
        self._append(seed, updates, reached)
        own = {"hyperparameters": plain, "scorings": scorings, **recording.source_of(policy)}
        path = result.write(reached, self._use(seed, seconds), own)
        self._usage.restart()
        del self._curves[seed]
        return path

    def results(self, folder: str | os.PathLike[str]) -> list[Result]:
        """The benchmark's results in `folder`, of all algorithms; a notebook shows a table.

        A RuntimeWarning says where there is no folder, as with a misspelt name.
        """
        return result_file.find(folder, self.name)

    def _scorings(self, policy: PolicyLike, episodes: int) -> dict[str, Any]:
        """The further evaluations of a result, by name, as the runner makes them."""
        names = [*([] if self.mask.all() else ["full"]), *(["served"] if self._noise else [])]
        scorings = {}
        for name in names:
            scores = self.evaluate(policy, episodes, observe=name)
            scorings[name] = recording.scoring_of(name, self._world(name), scores)
        return scorings

    def _use(self, seed: int, seconds: float) -> Use:
        """What the run with `seed` has used since the last result."""
        curve = self._curves[seed]
        ledger = self._usage.counts() | {"evaluation_episodes": curve.episodes}
        return Use(ledger, seconds, curve.points, self._usage.has_learned(ledger))

    def _append(self, seed: int, updates: int, returns: NDArray[np.float64]) -> None:
        mean = float(returns.mean())
        steps = self._usage.counts()["simulator_steps"]
        score = self._spec.normalised_score(mean)
        point = (updates, steps, mean, float(returns.std()), score)
        self._curves.setdefault(seed, Curve()).append(point, len(returns))

    def _world(self, observe: str) -> str:
        """The perturbations of an evaluation's environment."""
        noise = self._noise if observe == "served" else []
        return simulators.text_of([*simulators.parse(self.info.world), *noise])

    @functools.cached_property
    def _spec(self) -> EnvironmentSpec:
        return self._client.environments()[self.environment]

    @functools.cached_property
    def _seen_through(self) -> tuple[NamedArgument, ...]:
        """The perturbations, in parametric form, through which the training's policy observes.

        Those of the dataset are simulator perturbations, too, so it need not be there.
        """
        seen_through = self.info.corruption if self.info.dataset else self.info.simulator
        if not seen_through:
            return ()
        with self._client.make(self.environment, seen_through) as env:
            perturbations = env.session.in_force.perturbations
        return perturbations

    @property
    def _noise(self) -> list[NamedArgument]:
        return [item for item in self._seen_through if item.name == "obs-noise"]
