"""Compares two trainings of MOPO's ensemble, in fp32 and in bf16, from their saved states.

    python ensemble.py DATASET FP32 BF16

DATASET: the HDF5 file of HalfCheetah/medium. FP32, BF16: states of the two trainings after about
equally many updates, `ensemble.h5` of `b4mrl train --algorithm mopo`, copied while it ran. Prints,
for the present weights (not each member's best ones) on the hold-out rows, the data's last tenth:
the hold-out error of the seven members, their mean log-variance, and the penalty of the five
elites, max_i |std_i(o, a)|. Needs numpy and h5py.
"""

import sys

import h5py
import numpy as np

MEMBERS, ELITES, LAYERS, HOLDOUT = 7, 5, 5, 0.1


def holdout_rows(path: str) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (rows, 23) and targets (rows, 18): change of the observation, reward."""
    with h5py.File(path) as file:
        rows = len(file["rewards"])
        held = slice(rows - int(HOLDOUT * rows), rows)
        observations = file["observations"][held]
        change = file["next_observations"][held] - observations
        inputs = np.concatenate([observations, file["actions"][held]], 1)
        return inputs, np.concatenate([change, file["rewards"][held].reshape(-1, 1)], 1)


def predict(path: str, inputs: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """Means and log-variances (members, rows, 18) of the saved ensemble, and its updates."""
    with h5py.File(path) as file:
        group = file["ensemble"]
        activations = np.broadcast_to(inputs, (MEMBERS, *inputs.shape))
        for number in range(LAYERS):
            bias = group[f"ensemble.layer{number}.bias"][()].reshape(MEMBERS, 1, -1)
            weight = group[f"ensemble.layer{number}.weight"][()]
            weight = weight.reshape(MEMBERS, bias.shape[-1], activations.shape[-1])
            activations = activations @ weight.transpose(0, 2, 1) + bias
            if number < LAYERS - 1:
                with np.errstate(over="ignore"):  # of exp, for a swish of 0
                    activations = activations / (1 + np.exp(-activations))
        highest, lowest = group["max_log_var"][()], group["min_log_var"][()]
        updates = int(group["updates"][()])
    means, raw = np.split(activations, 2, axis=-1)
    log_variances = highest - np.logaddexp(0, highest - raw)
    return means, lowest + np.logaddexp(0, log_variances - lowest), updates


def figures(path: str, inputs: np.ndarray, targets: np.ndarray) -> tuple[int, list[float]]:
    """The ensemble's updates, and its hold-out errors, log-variance and penalty."""
    errors, log_variance, norms = np.zeros(MEMBERS), 0.0, []
    for first in range(0, len(inputs), 10_000):
        part = slice(first, first + 10_000)
        means, log_variances, updates = predict(path, inputs[part])
        errors += ((means - targets[part]) ** 2).mean(-1).sum(-1) / len(inputs)
        log_variance += log_variances.mean((0, 2)).sum() / len(inputs)
        norms.append(np.linalg.norm(np.exp(log_variances / 2), axis=-1))
    elites = np.argsort(errors)[:ELITES]
    penalty = np.concatenate(norms, 1)[elites].max(0).mean()
    return updates, [float(errors.mean()), float(errors.min()), log_variance, float(penalty)]


def main() -> None:
    dataset, *paths = sys.argv[1:]
    inputs, targets = holdout_rows(dataset)
    (fp32_updates, fp32), (bf16_updates, bf16) = (figures(path, inputs, targets) for path in paths)
    print(f"{'after updates':<32} {fp32_updates:>10} {bf16_updates:>10}")
    names = (
        "hold-out error, mean of members",
        "hold-out error, best member",
        "log-variance, mean",
        "penalty of the elites, mean",
    )
    for name, one, other in zip(names, fp32, bf16):
        print(f"{name:<32} {one:10.4f} {other:10.4f} {100 * (other / one - 1):+6.1f}%")


if __name__ == "__main__":
    main()
