#!/usr/bin/env python3
"""Packs recordings of highway-env into highway.npy and highway.json beside this program.

  convert_highway.py RECORDINGS...

RECORDINGS are JSON files in the layout that README.md describes. Long ones are cut to MAX_STATES states of a car,
and the states within a step are kept for the first MAX_FRAME_STEPS.
"""
import json
import pathlib
import sys

import numpy as np

MAX_STATES = 21 * 16
MAX_FRAME_STEPS = 2


def pack(recording):
    steps = min(len(recording["actions"]), MAX_STATES // len(recording["initial_state"]))
    frames = recording.get("frames", [])[:MAX_FRAME_STEPS]
    initial = np.column_stack([recording["initial_state"], recording["target_speed"], recording["delta"]])
    parts = [initial.ravel(), np.ravel(recording["initial_obs"])]
    for t in range(steps):
        outcome = [recording[key][t] for key in ("reward", "terminated", "truncated", "on_road")]
        parts += [np.ravel(recording["actions"][t]), np.ravel(recording["states"][t]), np.ravel(recording["obs"][t]),
                  np.array(outcome, dtype=np.float64)]
    parts.append(np.ravel(frames))
    index = {
        "name": recording["name"], "config": {**recording["config"], "env_id": recording["env_id"]},
        "seed": recording["seed"], "episode": recording.get("episode", 0), "scrambled": recording["scrambled"],
        "float32": recording["actions_are_float32"], "steps": steps,
        "strict_steps": min(recording["strict_steps"], steps), "vehicles": len(initial),
        "action_size": len(recording["actions"][0]), "observation_size": np.size(recording["initial_obs"]),
        "frame_steps": len(frames), "frames": len(frames[0]) if frames else 0}
    return index, np.concatenate(parts)


def main():
    here = pathlib.Path(__file__).parent
    index, values = [], []
    for path in sorted(sys.argv[1:], key=lambda p: pathlib.Path(p).name):
        entry, numbers = pack(json.loads(pathlib.Path(path).read_text()))
        entry["offset"] = sum(len(v) for v in values)
        index.append(entry)
        values.append(numbers)
    np.save(here / "highway.npy", np.concatenate(values).astype("<f8"))
    lines = ",\n ".join(json.dumps(entry) for entry in index)
    (here / "highway.json").write_text(f"[{lines}]\n")


if __name__ == "__main__":
    main()
