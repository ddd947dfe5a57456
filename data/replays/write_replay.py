"""Writes the actions of a training run's first transitions, so that they can be stepped again.

    python write_replay.py RUN TRANSITIONS OUT.h5        (needs numpy and h5py)

RUN is the folder of an online `b4mrl train`. Simulators are deterministic, so a run's transitions
follow from its seed and its actions, which take a tenth of the bytes. OUT.h5 holds `actions`,
(TRANSITIONS, action size) float32 in [-1, 1], before they are scaled to the environment's bounds.
`metadata/` in it holds the run's settings for stepping them again, and the SHA-256 of the first
64 + TRANSITIONS * record bytes of RUN's replay.bin, by which the result can be checked.

The program refuses runs whose newest checkpoint has fewer transitions, and runs in which a step
failed (the simulator crashed or left its range), since actions alone do not give their episodes.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

import h5py
import numpy as np

HEADER_BYTES = 64  # of replay.bin: magic, then the sizes of an observation and of an action


def newest_checkpoint(run: Path) -> Path:
    """The checkpoint of the latest update."""
    checkpoints = sorted(run.glob("checkpoint-*.h5"), key=lambda path: int(path.stem[11:]))
    if not checkpoints:
        sys.exit(f"{run} holds no checkpoint")
    return checkpoints[-1]


def stored_transitions(run: Path, lanes: int) -> int:
    """Transitions up to the newest checkpoint; ends the program if a step failed."""
    with h5py.File(newest_checkpoint(run)) as file:
        stored = int(file["lanes/replay_length"][()])
        vector_steps = int(file["lanes/vector_steps"][()])
    if vector_steps * lanes != stored:
        sys.exit(f"{run} gave up {vector_steps * lanes - stored} steps")
    return stored


def read_replay(run: Path, transitions: int) -> tuple[bytes, dict[str, np.ndarray]]:
    """The first bytes of replay.bin, with its header, and the transitions in them."""
    with open(run / "replay.bin", "rb") as file:
        header = file.read(HEADER_BYTES)
        observation_size, action_size = np.frombuffer(header, "<u4", count=2, offset=8).tolist()
        floats = 2 * observation_size + action_size + 2
        records = file.read(transitions * floats * 4)
    table = np.frombuffer(records, "<f4").reshape(transitions, floats)
    ends = np.cumsum([observation_size, action_size, observation_size])
    observations, actions, next_observations, rest = np.split(table, ends, axis=1)
    return header + records, {
        "observations": observations,
        "actions": actions,
        "next_observations": next_observations,
        "rewards": rest[:, 0],
        "terminals": rest[:, 1] == 0,  # stored is 1 - terminated
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="folder of the run")
    parser.add_argument("transitions", type=int, help="number of transitions")
    parser.add_argument("out", type=Path, help="file to write")
    arguments = parser.parse_args()

    record = json.loads((arguments.run / "run.json").read_text())
    lanes = int(record["hyperparameters"]["lanes"])
    stored = stored_transitions(arguments.run, lanes)
    if stored < arguments.transitions:
        sys.exit(
            f"the newest checkpoint of {arguments.run} has {stored} transitions, "
            f"{arguments.transitions} asked for"
        )
    replay, columns = read_replay(arguments.run, arguments.transitions)
    actions = columns["actions"]

    metadata = {
        "environment": record["environment"],
        "simulator": record["simulator"],
        "seed": record["seed"],
        "warm_up": int(record["hyperparameters"]["warm-up"]),
        "lanes": lanes,
        "autoreset": "same_step",
        "command": record["command"],
        "transitions": arguments.transitions,
        "replay_sha256": hashlib.sha256(replay).hexdigest(),
    }
    with h5py.File(arguments.out, "w") as file:
        file.create_dataset(
            "actions",
            data=actions,
            chunks=(min(10_000, arguments.transitions), actions.shape[1]),
            compression="gzip",
            compression_opts=9,
            shuffle=True,
        )
        for name, value in metadata.items():
            file[f"metadata/{name}"] = np.bytes_(value) if isinstance(value, str) else value


if __name__ == "__main__":
    main()
