"""Results: the files in which `b4mrl benchmark run` and Benchmark.record keep what a run reached.

One JSON file a run, with one line for each entry and for each point of the curve. Readers must
expect entries that they do not know. The entries are those of benchmarks/records/result_file.cc;
what a user's own algorithm lacks (precision, recipe) is null, and so is the budget: a result that
names one was scored by `b4mrl evaluate`, to whose last bits `b4mrl benchmark check` holds it.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import reprlib
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from b4mrl.benchmarks.folders import folder_of_results
from b4mrl.benchmarks.seeds import hash_name
from b4mrl.descriptions import BenchmarkInfo, DatasetInForce
from b4mrl.display import Listing, Record
from b4mrl.errors import DataLossError, InvalidArgumentError, warn
from b4mrl.version import __version__
from b4mrl.wire import checks

# Names of `b4mrl list algorithms`: their results are written by the program alone.
ALGORITHMS = ("sac", "td3", "bc", "td3-bc", "iql", "mopo", "h2o", "hymopo")
_NAME_RULE = "1 to 40 letters (A to Z, a to z), digits and dashes"  # as of the runner's --name

CURVE_COLUMNS = ("updates", "steps", "return", "std", "score")
Point = tuple[int, int, float, float, float | None]

# Entries of a result that become attributes.
_TYPES: dict[str, tuple[type, ...]] = {
    "algorithm": (str,),
    "seed": (int,),
    "updates": (int,),
    "finished": (bool,),
    "score": (float, int, type(None)),
    "return": (float, int),
    "settled": (bool, type(None)),
    "source": (str,),
}
_NAMES_OF_TYPES = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    type(None): "null",
}

_ID_DIGITS = 16
# The largest drift of a settled run between the last two fifths: in points or, where there are no
# scores, as a share of the span of its mean returns.
_SETTLED_POINTS = 1.5
_SETTLED_SHARE = 0.03
_MAX_RUN_NAME = 200


@dataclass(frozen=True, repr=False)
class Result(Record):
    """A result file.

    Attributes:
        score: normalised score after the last update; None where the task has no reference.
        mean_return: mean return after the last update.
        settled: whether the means of the curve's last two fifths differ by at most 1.5 points or,
            of returns without scores, 3% of the span of the curve's mean returns; None
            where a fifth has no point.
        source: "own" for a run of `b4mrl train`, "user" for a user's algorithm that b4mrl has
            scored, "self-scored" for one whose returns the user gave.
        entries: the whole file.
    """

    algorithm: str
    seed: int
    updates: int
    finished: bool
    score: float | None
    mean_return: float
    settled: bool | None
    source: str
    path: Path
    entries: dict[str, Any]

    def _facts(self) -> Mapping[str, Any]:
        return {name: value for name, value in super()._facts().items() if name != "entries"}


def find(folder: str | os.PathLike[str], benchmark: str) -> list[Result]:
    """The results of a benchmark in `folder`, in order of names.

    A folder without results of its own, such as that of a runner, may have them in its subfolder
    `results`, as for `b4mrl report`. Files that are no results of the benchmark are left out. A
    RuntimeWarning says where there is no folder.
    DataLossError: a file holds no JSON, or a result of the benchmark lacks an entry or has one of
    another type; the message names both.
    """
    place = folder_of_results(checks.path("folder", folder))
    if not place.is_dir():
        warn(f"there is no folder {place}, and so no result")
    found: list[Result] = Listing()
    for path in sorted(place.glob("*.json")):
        try:
            entries = json.loads(path.read_text(encoding="utf-8"))
        except (ValueError, RecursionError) as error:
            raise DataLossError(f"{path} holds no JSON that can be read: {error}") from None
        names = entries.get("benchmarks") if isinstance(entries, dict) else None
        if isinstance(names, list) and benchmark in names:
            found.append(_result_of(path, entries))
    return found


def _result_of(path: Path, entries: dict[str, Any]) -> Result:
    for name, types in _TYPES.items():
        if name not in entries:
            raise DataLossError(f"{path} is a result without the entry {name!r}")
        if type(entries[name]) not in types:
            allowed = ", ".join(_NAMES_OF_TYPES[each] for each in types)
            value = reprlib.repr(entries[name])
            raise DataLossError(f"{path} is a result whose {name} is {value}, allowed: {allowed}")
    given = {name: entries[name] for name in _TYPES if name != "return"}
    return Result(**given, mean_return=entries["return"], path=path, entries=entries)


def check_name(algorithm: Any) -> str:
    """`algorithm`. InvalidArgumentError: no algorithm can have the name, for the names of files."""
    name = checks.text("algorithm", algorithm)
    if not re.fullmatch(r"[A-Za-z0-9-]{1,40}", name):
        raise InvalidArgumentError(f"algorithm is {reprlib.repr(name)}, allowed: {_NAME_RULE}")
    return name


def check_algorithm(algorithm: Any, info: BenchmarkInfo) -> None:
    """InvalidArgumentError: no user's algorithm can have the name, or not in this benchmark."""
    name = check_name(algorithm)
    if name.casefold() in ALGORITHMS:  # reports title "TD3-BC" what is named "td3-bc"
        raise InvalidArgumentError(
            f"algorithm is {name!r}, allowed: {_NAME_RULE}, but none of B4MRL's own algorithms "
            f"({', '.join(ALGORITHMS)}), in capital or small letters, whose results "
            "`b4mrl benchmark run` writes"
        )
    if not info.is_defined_for(name):
        allowed = f"all but {', '.join(info.exceptions)}"
        if info.algorithms:
            allowed = f"{', '.join(info.algorithms)} alone"
        raise InvalidArgumentError(
            f"algorithm is {name!r}, allowed in {info.name}: {allowed}; b4mrl.suite(algorithm="
            f"{name!r}) has the benchmarks that are defined for it"
        )


def plain_hyperparameters(given: Mapping[str, Any] | None) -> dict[str, Any]:
    """A copy for a result; {} for None. InvalidArgumentError: JSON cannot hold them."""
    allowed = "a dict from names to numbers and texts"
    plain = dict(checks.mapping("hyperparameters", {} if given is None else given, allowed))
    try:
        _compact(plain).encode()
    except InvalidArgumentError:
        raise
    except (ValueError, TypeError, RecursionError) as error:
        raise InvalidArgumentError(
            f"hyperparameters are {reprlib.repr(plain)}, allowed: {allowed} ({error})"
        ) from None
    return plain


def entries_of(
    info: BenchmarkInfo,
    algorithm: str,
    seed: int,
    dataset: DatasetInForce | None,
    returns: NDArray[np.float64],
    curve: Sequence[Point],
) -> dict[str, Any]:
    """A result of a finished run whose curve ends with the mean of `returns`.

    The caller fills in hyperparameters, scorings, source, ledger and seconds, and adds agent_sha256
    where the policy came from a file.
    """
    rows = None if dataset is None else dataset.info.rows
    updates, steps, mean, _, score = curve[-1]
    run, cell = identities(info, algorithm, rows, seed)
    return {
        "id": run,
        "cell": cell,
        "benchmarks": [info.name],
        "suite": info.suite,
        "algorithm": algorithm,
        "environment": info.environment,
        "simulator": info.simulator,
        "dataset": None if dataset is None else _described(dataset),
        "corruption": info.corruption,
        "corruption_seed": 0,
        "transitions": "stored",
        "history": 1,
        "world": info.world,
        "seed": seed,
        "precision": None,
        "recipe": None,
        "hyperparameters": {},
        "budget": None,
        "planned_updates": updates,
        "updates": updates,
        "finished": True,
        "score": score,
        "return": mean,
        "returns": returns.tolist(),
        "scorings": {},
        **_drift(curve),
        "source": "",
        "selection": "last",
        "environment_steps": steps,
        "ledger": {},
        "seconds": 0.0,
        "version": __version__,
        "commit": None,
        "processor": _processor(),
        "sessions": [],
        "curve_columns": CURVE_COLUMNS,
        "curve": curve,
    }


def _described(dataset: DatasetInForce) -> dict[str, Any]:
    return {
        "name": dataset.provenance.name or dataset.info.name,
        "rows": dataset.info.rows,
        "sha256": dataset.info.sha256,
        "columns_sha256": dataset.info.columns_sha256,
    }


def identities(
    info: BenchmarkInfo, algorithm: str, dataset_rows: int | None, seed: int
) -> tuple[str, str]:
    """The ids of the run and of its cell: only results of equal cells may be averaged."""
    identity: dict[str, Any] = {
        "algorithm": algorithm,
        "benchmark": info.name,
        "rows": dataset_rows,
        "suite": info.suite,
    }
    return _digest(identity | {"seed": seed}), _digest(identity)


def _digest(identity: Mapping[str, Any]) -> str:
    text = json.dumps(identity, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:_ID_DIGITS]


def run_name(info: BenchmarkInfo, algorithm: str, seed: int) -> str:
    """Such as "HalfCheetah-mine-gravity-medium+hidden-high-s0" (algorithms/run/run_record.h)."""
    name = f"{info.environment}-{algorithm}"
    if info.simulator or info.dataset:
        name += f"-{info.simulator or 'true'}"
    own_dataset = info.dataset.startswith(f"{info.environment}/")
    if info.dataset:
        name += f"-{info.dataset.removeprefix(f'{info.environment}/')}"
    if info.corruption:
        name += f"+{info.corruption}"
    if info.world:
        name += f"-in-{info.world}"
    name += f"-s{seed}"
    plain = re.sub(r"[^A-Za-z0-9.,=+-]", "_", name)
    if plain == name and len(name) <= _MAX_RUN_NAME and (own_dataset or not info.dataset):
        return name
    return f"{plain[: _MAX_RUN_NAME - 17]}-{hash_name(name):016x}"


def _drift(curve: Sequence[Point]) -> dict[str, Any]:
    """The entries last_fifth, fifth_before and settled of a curve."""
    last, before = _mean_between(curve, 0.8, 1), _mean_between(curve, 0.6, 0.8)
    settled = None
    if last is not None and before is not None:
        settled = abs(last - before) <= _tolerance(curve)
    return {"last_fifth": last, "fifth_before": before, "settled": settled}


def _tolerance(curve: Sequence[Point]) -> float:
    """By how much the last two fifths of a settled curve may differ."""
    if curve[-1][4] is not None:
        return _SETTLED_POINTS
    returns = [point[2] for point in curve]
    return _SETTLED_SHARE * (max(returns) - min(returns))


def _mean_between(curve: Sequence[Point], low: float, high: float) -> float | None:
    """The mean score, or return where there is no score, of the points in (low, high] of a run."""
    end = curve[-1][0]
    chosen = [
        mean if score is None else score
        for updates, _, mean, _, score in curve
        if low * end < updates <= high * end
    ]
    return float(np.mean(chosen)) if chosen else None


def _processor() -> str:
    """The processor's name, as the runner writes it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text("utf-8", "replace").splitlines():
            if line.startswith("model name"):
                return line.partition(": ")[2]
    return "unknown processor"


def sha256_of(path: str | os.PathLike[str]) -> str:
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()


class Earlier(NamedTuple):
    """What a folder's result of a run says."""

    path: Path
    updates: int
    curve: list[Point]
    ledger: dict[str, int]
    seconds: float

    def repeats(self, updates: int, curve: Sequence[Point]) -> bool:
        """Whether a result of these updates with this curve may be of the same training."""
        return self.updates == updates and len(curve) == 1 and len(self.curve) > 0

    def with_end(self, end: Point) -> list[Point]:
        """The curve with another evaluation at its end."""
        updates, _, mean, deviation, score = end
        return [*self.curve[:-1], (updates, self.curve[-1][1], mean, deviation, score)]


def earlier(
    folder: Path, info: BenchmarkInfo, algorithm: str, seed: int, dataset: DatasetInForce | None
) -> Earlier | None:
    """The folder's result of a run; None if there is none that can be read."""
    run_id, _ = identities(info, algorithm, None if dataset is None else dataset.info.rows, seed)
    path = _path_of(folder, info, algorithm, seed, run_id)
    try:
        entries = json.loads(path.read_text(encoding="utf-8"))
        curve: list[Any] = [tuple(point) for point in entries["curve"]]
        updates, seconds = int(entries["updates"]), float(entries["seconds"])
        if any(len(point) != len(CURVE_COLUMNS) for point in curve):
            return None
        return Earlier(path, updates, curve, dict(entries["ledger"]), seconds)
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return None


def _path_of(folder: Path, info: BenchmarkInfo, algorithm: str, seed: int, run_id: str) -> Path:
    return folder / f"{run_name(info, algorithm, seed)}-{run_id}.json"


def write(folder: Path, info: BenchmarkInfo, entries: Mapping[str, Any]) -> Path:
    """Writes the file "<name>-<id>.json", whole or not at all; replaces one of the same run."""
    path = _path_of(folder, info, entries["algorithm"], entries["seed"], entries["id"])
    unfinished = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        with unfinished.open("w", encoding="utf-8") as file:
            file.write(_text_of(entries))
            file.flush()
            # Else a machine that fails may leave an empty file of that name.
            os.fsync(file.fileno())
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
    return path


def _text_of(entries: Mapping[str, Any]) -> str:
    lines = [f' "{name}": {_value(name, value)}' for name, value in entries.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _value(name: str, value: Any) -> str:
    if name == "curve":
        return "[\n" + ",\n".join(f"  {_compact(point)}" for point in value) + "\n ]"
    return _compact(value)


def _compact(value: Any) -> str:
    return json.dumps(
        value, separators=(",", ":"), ensure_ascii=False, allow_nan=False, default=_plain
    )


def _plain(value: Any) -> Any:
    """A number or an array of numpy as Python's."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise InvalidArgumentError(f"hyperparameters have {value!r}, allowed: numbers and texts")
