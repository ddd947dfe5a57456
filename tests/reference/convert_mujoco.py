#!/usr/bin/env python3
"""Converts recordings of the original tasks to the small files beside this program.

  convert_mujoco.py RECORDINGS MODELS

RECORDINGS holds <task>_traj.npz (and half_cheetah_traj_gravity2.npz), MODELS <task>_model.json and
<task>_model_friction03.json; README.md says what is in them and what becomes of them.
"""
import json
import pathlib
import sys

import numpy as np

TASKS = ("half_cheetah", "hopper", "walker2d", "humanoid")

# What may differ between two spellings of one model.
FREE = {
    "mujoco_version", "model_name", "nsite", "ncam", "nlight", "neq", "nsensor", "nkey", "npair", "nexclude",
    "njmax", "nconmax", "nstack", "jnt_range", "geom_rgba",
    "cam_names", "cam_pos", "cam_quat", "cam_mode", "cam_fovy", "cam_bodyid",
}


def flatten(value):
    if not isinstance(value, list):
        return value
    flat = []
    for entry in value:
        flat.extend(entry if isinstance(entry, list) else [entry])
    return flat


def convert_model(models, task, out):
    model = json.loads((models / f"{task}_model.json").read_text())
    rough = json.loads((models / f"{task}_model_friction03.json").read_text())
    fields = {name: flatten(value) for name, value in model.items() if name not in FREE}
    fields["jnt_range_of_limited_joints"] = flatten(
        [r for r, limited in zip(model["jnt_range"], model["jnt_limited"]) if limited])
    fields["geom_friction_times_0.3"] = flatten(rough["geom_friction"])
    if not any(fields["actuator_names"]):
        del fields["actuator_names"]
    lines = [f'  "{name}": {json.dumps(value)}' for name, value in fields.items()]
    (out / f"{task}_model.json").write_text("{\n" + ",\n".join(lines) + "\n}\n")


def convert_trajectories(recordings, task, variant, out):
    z = np.load(recordings / f"{task}_traj{variant}.npz")
    first = [np.zeros_like(z["action"][:, :1]), z["init_qpos"][:, None], z["init_qvel"][:, None],
             z["qacc_warmstart"][:, :1], z["init_obs"][:, None], np.zeros((len(z["init_obs"]), 1, 3))]
    steps = [z["action"], z["qpos"], z["qvel"], z["qacc_warmstart"][:, 1:], z["obs"],
             z["reward"][..., None], z["reward_v5"][..., None], z["terminated"][..., None]]
    rows = np.concatenate([np.concatenate(first, axis=2), np.concatenate(steps, axis=2)], axis=1)
    np.save(out / f"{task}{variant}.npy", rows.astype("<f8"))


def main():
    recordings, models = map(pathlib.Path, sys.argv[1:3])
    out = pathlib.Path(__file__).parent
    for task in TASKS:
        convert_model(models, task, out)
        convert_trajectories(recordings, task, "", out)
    convert_trajectories(recordings, "half_cheetah", "_gravity2", out)


if __name__ == "__main__":
    main()
