"""Compares benchmarks/statistics with rliable: run compare_rliable.py RLIABLE_PROGRAM.

rliable draws its own resamples; they are recorded and given to the program, so that intervals must
agree to rounding and not only within the bootstrap's noise.
"""

import json
import subprocess
import sys

import numpy as np
from rliable import library, metrics

RESAMPLES = 500
THRESHOLDS = np.linspace(-20, 120, 29)
# Both sum some hundred numbers of about 100 in different orders.
POINT_TOLERANCE = 1e-12
INTERVAL_TOLERANCE = 1e-9


def aggregates(scores):
    return np.array(
        [
            metrics.aggregate_iqm(scores),
            metrics.aggregate_median(scores),
            metrics.aggregate_mean(scores),
            *library.score_distributions(scores, THRESHOLDS),
        ]
    )


def improvement(x, y):
    return np.array([metrics.probability_of_improvement(x, y)])


def recorded(bootstrap):
    """That class of rliable, which keeps the indices of its resamples in the list `drawn`."""

    class Recorded(bootstrap):
        drawn = []

        def update_indices(self):
            indices = super().update_indices()
            self.drawn.append(indices)
            return indices

    return Recorded


def resample_of(algorithms):
    """One resample in the form of bootstrap.h, from pairs (runs x benchmarks, benchmarks)."""
    return {
        "benchmarks": algorithms[0][1].ravel().tolist(),
        "runs": [runs.T.tolist() for runs, _ in algorithms],
    }


def rliable_answer(scores, statistic, task_bootstrap):
    """rliable's point estimates and intervals, and the resamples that it drew."""
    single = recorded(library.StratifiedBootstrap)
    paired = recorded(library.StratifiedIndependentBootstrap)
    originals = library.StratifiedBootstrap, library.StratifiedIndependentBootstrap
    library.StratifiedBootstrap, library.StratifiedIndependentBootstrap = single, paired
    points, intervals = library.get_interval_estimates(
        {"it": scores[0] if len(scores) == 1 else scores},
        statistic,
        task_bootstrap=task_bootstrap,
        reps=RESAMPLES,
    )
    library.StratifiedBootstrap, library.StratifiedIndependentBootstrap = originals
    resamples = [resample_of([indices]) for indices in single.drawn]
    resamples += [resample_of(positional) for positional, _ in paired.drawn]
    return points["it"], intervals["it"].T, resamples


def compare(program, name, scores, statistic, task_bootstrap=False):
    points, intervals, resamples = rliable_answer(scores, statistic, task_bootstrap)
    assert len(resamples) == RESAMPLES, f"rliable drew {len(resamples)} resamples"
    question = {
        "scores": [runs.T.tolist() for runs in scores],
        "thresholds": THRESHOLDS.tolist(),
        "resamples": resamples,
    }
    answer = json.loads(
        subprocess.run(
            [program], input=json.dumps(question), capture_output=True, check=True, text=True
        ).stdout
    )
    off = np.abs(np.array(answer["points"]) - points).max()
    ends_off = np.abs(np.array(answer["intervals"]) - intervals).max()
    assert off <= POINT_TOLERANCE, f"{name}: point estimates differ by {off}"
    assert ends_off <= INTERVAL_TOLERANCE, f"{name}: intervals differ by {ends_off}"
    # Else there were nothing to agree on.
    assert np.any(intervals[:, 0] < intervals[:, 1]), f"{name}: no interval has a width"
    print(f"{name}: {len(points)} estimates within {off:.1e}, intervals within {ends_off:.1e}")


def main(program):
    np.random.seed(19)  # rliable draws from numpy's global generator
    # Whole numbers tie within and between algorithms.
    three_runs = np.round(np.random.normal(40, 30, (3, 17)))
    five_runs = np.round(np.random.normal(50, 30, (5, 17)))
    one_run = np.random.normal(40, 30, (1, 52))
    compare(program, "3 runs of 17 benchmarks", [three_runs], aggregates)
    compare(program, "the same, benchmarks drawn", [three_runs], aggregates, True)
    compare(program, "1 run of 52, benchmarks drawn", [one_run], aggregates, True)
    compare(program, "improvement, 3 against 5 runs", [three_runs, five_runs], improvement)


main(sys.argv[1])
