"""Whether learners score as well in bf16 as in fp32: pairs of runs with equal seeds.

    python proof.py run [NAME...]      trains the runs of `commands` in runs/precision, resuming what
                                       was begun, and collects each when it has finished
    python proof.py collect FOLDER...  adds the evaluations of finished runs in these folders (of
                                       `b4mrl train`, named as in `commands`) to the CSV files
    python proof.py table              the comparison, from the CSV files

The CSV files stand beside this one, one for each benchmark. Equivalence is shown where the 90%
interval (Student's t) of the difference bf16 - fp32, paired by seed, lies within 2 points; a run's
score is the mean over its evaluations in the last fifth of its updates. B4MRL names another build
of b4mrl than build/release. Needs Python 3.11 alone.

ensemble/ holds the hold-out error of the best member after each epoch of an ensemble's training:
`b4mrl train --algorithm mopo --environment HalfCheetah --dataset HalfCheetah/medium --seed 0
--ensemble-max-updates 150000 --ensemble-patience 1000`.
"""

import csv
import json
import math
import os
import pathlib
import re
import statistics
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
NAME = re.compile(r"(?P<benchmark>.+)-(?P<precision>fp32|bf16)-s(?P<seed>\d+)")
COLUMNS = ["precision", "seed", "update", "return", "score"]
MARGIN = 2.0  # points of the normalised score
LAST_SHARE = 0.2  # of a run's updates, over which its score is the mean
# 95% quantiles of Student's t for 1, 2, ... degrees of freedom: both sides of a 90% interval.
T95 = [6.314, 2.920, 2.353, 2.132, 2.015, 1.943, 1.895, 1.860, 1.833]


def commands() -> dict[str, list[str]]:
    lines = (HERE / "commands").read_text().splitlines()
    split = (line.split(": ", 1) for line in lines if line and not line.startswith("#"))
    return {name: options.split() for name, options in split}


def read_curves(path: pathlib.Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open() as file:
        return list(csv.DictReader(file))


def collect(folder: pathlib.Path) -> None:
    """Puts a finished run's evaluations into its benchmark's file, in place of earlier ones."""
    name = NAME.fullmatch(folder.name)
    if name is None or json.loads((folder / "result.json").read_text())["state"] != "finished":
        sys.exit(f"{folder} is no finished run of `commands`")
    path = HERE / f"{name['benchmark']}.csv"
    run = (name["precision"], name["seed"])
    rows = [row for row in read_curves(path) if (row["precision"], row["seed"]) != run]
    with (folder / "progress.csv").open() as file:
        for line in csv.DictReader(file):
            if line["eval/score"]:
                mean, score = float(line["eval/mean_reward"]), float(line["eval/score"])
                values = (*run, line["train/n_updates"], f"{mean:.1f}", f"{score:.2f}")
                rows.append(dict(zip(COLUMNS, values)))
    rows.sort(key=lambda row: (int(row["seed"]), row["precision"], int(row["update"])))
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def run(names: list[str]) -> None:
    b4mrl = os.environ.get("B4MRL", str(ROOT / "build/release/b4mrl"))
    for name in names or commands():
        folder = pathlib.Path("runs/precision") / name
        options = [*commands()[name], "--out", str(folder), "--resume"]
        subprocess.run([b4mrl, "train", *options], check=True)
        collect(folder)


def final_scores(path: pathlib.Path) -> dict[tuple[int, str], float]:
    """The score of each run, by seed and precision."""
    curves: dict[tuple[int, str], list[tuple[int, float]]] = {}
    for row in read_curves(path):
        key = (int(row["seed"]), row["precision"])
        curves.setdefault(key, []).append((int(row["update"]), float(row["score"])))
    return {
        key: statistics.fmean(s for u, s in curve if u > (1 - LAST_SHARE) * max(curve)[0])
        for key, curve in curves.items()
    }


def table() -> None:
    print("| benchmark | seeds | fp32 | bf16 | difference | 90% interval | within 2 points |")
    print("|---|---|---|---|---|---|---|")
    for path in sorted(HERE.glob("*.csv")):
        scores = final_scores(path)
        seeds = sorted(s for s, precision in scores if precision == "bf16" and (s, "fp32") in scores)
        if not seeds:
            continue
        fp32 = [scores[seed, "fp32"] for seed in seeds]
        bf16 = [scores[seed, "bf16"] for seed in seeds]
        differences = [b - f for f, b in zip(fp32, bf16)]
        mean = statistics.fmean(differences)
        interval, verdict = "-", "-"
        if 1 < len(seeds) <= len(T95) + 1:
            error = statistics.stdev(differences) / math.sqrt(len(seeds))
            low, high = mean - T95[len(seeds) - 2] * error, mean + T95[len(seeds) - 2] * error
            interval = f"{low:+.2f} to {high:+.2f}"
            verdict = "yes" if -MARGIN <= low and high <= MARGIN else "no"
        print(
            f"| {path.stem} | {len(seeds)} | {statistics.fmean(fp32):.2f} | "
            f"{statistics.fmean(bf16):.2f} | {mean:+.2f} | {interval} | {verdict} |"
        )


def main() -> None:
    action, *rest = sys.argv[1:] or [""]
    if action == "run":
        run(rest)
    elif action == "collect" and rest:
        for folder in rest:
            collect(pathlib.Path(folder))
    elif action == "table" and not rest:
        table()
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main()
