"""Compares a suite's results with those of another one that was trained in one go.

    compare_results.py RESULTS UNDISTURBED COUNT

COUNT: how many runs there are.
"""
import json
import pathlib
import sys


def results(folder):
    """The results by file name, without what differs from one training to another."""
    found = {}
    for path in pathlib.Path(folder).iterdir():
        result = json.loads(path.read_text())
        # An agent's file names its command line, with the folder. Batches are asked for ahead, so a resumed run has
        # received some twice.
        for entry in "agent_sha256", "seconds", "sessions":
            result.pop(entry)
        result["ledger"].pop("dataset_rows")
        found[path.name] = result
    return found


disturbed, undisturbed = results(sys.argv[1]), results(sys.argv[2])
assert len(undisturbed) == int(sys.argv[3]), sorted(undisturbed)
assert sorted(disturbed) == sorted(undisturbed), (sorted(disturbed), sorted(undisturbed))
for name, result in disturbed.items():
    assert result["finished"], name
    assert result == undisturbed[name], f"{name} differs:\n{result}\n{undisturbed[name]}"
print(f"all {len(disturbed)} results are equal")
