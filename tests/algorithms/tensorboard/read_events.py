"""Compares what TensorBoard reads from a run's event file with the run's metrics.jsonl."""

import json
import sys
from pathlib import Path

import numpy
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

folder = Path(sys.argv[1])
rows = [json.loads(line) for line in (folder / "metrics.jsonl").read_text().splitlines()]
accumulator = EventAccumulator(str(folder), size_guidance={"scalars": 0})  # 0: all of them
accumulator.Reload()

read = {
    tag: [(event.step, numpy.float32(event.value)) for event in accumulator.Scalars(tag)]
    for tag in accumulator.Tags()["scalars"]
}
for tag in ("episodic_return", "evaluation_return", "evaluation_score", "updates_per_second"):
    assert f"charts/{tag}" in read, f"charts/{tag} is missing"
assert "losses/critic_loss" in read
for tag, values in read.items():
    name = tag.split("/")[1]
    logged = [(row["update"], numpy.float32(row[name])) for row in rows if name in row]
    # metrics.jsonl has nine digits, which name a float, or its neighbour after a rounded double.
    assert [step for step, _ in values] == [step for step, _ in logged], f"steps of {tag}"
    numpy.testing.assert_allclose(
        [value for _, value in values], [value for _, value in logged], rtol=2e-7, err_msg=tag
    )
names = set().union(*rows) - {"update"}
assert len(read) == len(names), f"{sorted(read)} against {sorted(names)}"
print(f"TensorBoard reads {len(read)} tags, {sum(map(len, read.values()))} values")
