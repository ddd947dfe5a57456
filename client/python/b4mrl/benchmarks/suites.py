"""Benchmarks by name, without a client: the entry points b4mrl.benchmark and b4mrl.suite."""

from __future__ import annotations

import fnmatch
import os
from pathlib import Path

from b4mrl import catalogue, errors
from b4mrl.benchmarks import result_file
from b4mrl.benchmarks.benchmark import Benchmark
from b4mrl.client import Client
from b4mrl.descriptions import BenchmarkInfo
from b4mrl.display import Listing
from b4mrl.registration import connect
from b4mrl.wire import checks


def benchmark(name: str | None = None, *, endpoint: str | None = None, rows: int = 0) -> Benchmark:
    """A benchmark of the catalogue, such as "HalfCheetah/confounding/hidden-high+medium".

    Args:
        name: None: the benchmark for which `b4mrl benchmark run --learner` has started this
            program. Then `seed`, `updates` and `out` say what the runner asks for, and what the
            program uses counts in the runner's ledger.
        endpoint: the daemon's address. None: $B4MRL_ENDPOINT, else one private daemon for the
            process.
        rows: number of rows of the dataset, if the daemon's data folder lacks the dataset and it is
            made. 0: as published, which takes minutes. One that is there is used as it is; a
            RuntimeWarning says if it has other rows.

    Raises:
        UnknownNameError: there is no such benchmark; the message has the nearest name.
        FailedPreconditionError: `name` is None, and the runner has not started this program.
    """
    rows = checks.integer("rows", rows, 0, None)
    client = connect(endpoint)
    if name is not None:
        info = catalogue.find_benchmark(client.benchmarks(), name)
        return Benchmark(client, info, make_rows=rows)
    return Benchmark(
        client,
        catalogue.find_benchmark(client.benchmarks(), _asked("BENCHMARK")),
        make_rows=rows,
        seed=_number("SEED", _asked("SEED")),
        updates=_number("UPDATES", _asked("UPDATES")),
        out=Path(_asked("OUT")),
        ledger=_number("LEDGER", os.environ.get("B4MRL_LEDGER") or "0"),
    )


def suite(
    pattern: str = "*",
    *,
    algorithm: str | None = None,
    version: str | None = None,
    endpoint: str | None = None,
    rows: int = 0,
) -> list[Benchmark]:
    """The benchmarks whose names fit a pattern, in the order of the catalogue.

    Args:
        pattern: "*" stands for any text and "?" for any character: "HalfCheetah/confounding/*".
        algorithm: leaves out what is not defined for an algorithm of that name, such as your own,
            whose results Benchmark.record then refuses. A name is 1 to 40 letters (A to Z, a to z),
            digits and dashes. `b4mrl benchmark run --learner` leaves out the same, and also, as
            this function does not, benchmarks whose dataset is missing and has no recipe that can
            make it: their `dataset` raises FailedPreconditionError. None: leaves out nothing.
        version: of the suites, "v0". None: all versions that the daemon has, as for the runner.
        endpoint, rows: as for `benchmark`. A dataset is made when it is first used.

    UnknownNameError: no benchmark fits, or none that does is defined for the algorithm.
    InvalidArgumentError: no algorithm can have the name.
    """
    pattern = checks.text("pattern", pattern)
    if version is not None:
        checks.text("version", version)
    if algorithm is not None:
        result_file.check_name(algorithm)
    rows = checks.integer("rows", rows, 0, None)
    client: Client = connect(endpoint)
    known = client.benchmarks()
    if version is not None:
        known = _of_version(known, version)
    found = [info for info in known if fnmatch.fnmatchcase(info.name, pattern)]
    if not found:
        nearest = [_corrected(pattern, info.name) for info in known]
        raise errors.unknown_name("benchmark", pattern, nearest, "`b4mrl list benchmarks` has all")
    if algorithm is not None:
        found = [info for info in found if info.is_defined_for(algorithm)]
    if not found:
        raise errors.UnknownNameError(
            f"no benchmark that fits {pattern!r} is defined for the algorithm {algorithm!r}; "
            "`b4mrl list benchmarks` says for which each is"
        )
    return Listing(Benchmark(client, info, make_rows=rows) for info in found)


def _of_version(known: list[BenchmarkInfo], version: str) -> list[BenchmarkInfo]:
    """Those of the suites of a version. UnknownNameError: there is none of that version."""
    versions = sorted({info.suite for info in known})
    if version not in versions:
        raise errors.unknown_name("version of suites", version, versions, ", ".join(versions))
    return [info for info in known if info.suite == version]


def _corrected(pattern: str, name: str) -> str:
    """The pattern that fits a benchmark and was perhaps meant by one that fits none.

    Parts of `pattern` that fit the benchmark's stay: "Hopper/claen/*" becomes "Hopper/clean/*".
    """
    wanted = pattern.split("/")
    parts = name.split("/", len(wanted) - 1)  # the last one of a short pattern stands for the rest
    if len(parts) != len(wanted):
        return name
    return "/".join(w if fnmatch.fnmatchcase(p, w) else p for w, p in zip(wanted, parts))


def _asked(name: str) -> str:
    """A variable that `b4mrl benchmark run --learner` sets for the learner's program."""
    value = os.environ.get(f"B4MRL_{name}")
    if not value:
        raise errors.FailedPreconditionError(
            f"B4MRL_{name} is not set: name a benchmark, or start this program by `b4mrl benchmark "
            "run --learner COMMAND --name NAME`"
        )
    return value


def _number(name: str, text: str) -> int:
    """The number in such a variable. InvalidArgumentError: it holds none."""
    if not (text.isascii() and text.isdigit()):
        raise errors.InvalidArgumentError(
            f"B4MRL_{name} is {text!r}, allowed: a whole number from 0 on"
        )
    return int(text)
