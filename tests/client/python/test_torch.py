"""The recipe of the README for PyTorch's DataLoader."""

from __future__ import annotations

import importlib
import itertools
import sys
from pathlib import Path

import b4mrl
import pytest

from made_dataset import write_example
from test_documents import program_with

torch = pytest.importorskip("torch", reason="PyTorch is not installed")


def recipe(folder: Path, monkeypatch: pytest.MonkeyPatch) -> type:
    """The README's class, from a module: workers that are spawned import it by its name."""
    text = program_with("DataLoader").split("\n\n\n")[0]
    (folder / "recipe.py").write_text("import torch\n" + text)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "recipe", raising=False)
    return importlib.import_module("recipe").Batches


@pytest.mark.parametrize(
    "options",
    [
        {"num_workers": 0},
        {"num_workers": 2, "multiprocessing_context": "fork"},
        {"num_workers": 2, "multiprocessing_context": "spawn", "persistent_workers": True},
    ],
    ids=["alone", "fork", "spawn"],
)
def test_a_data_loader_has_other_batches_in_each_worker_and_epoch(
    tmp_path: Path, options: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_example(tmp_path / "HalfCheetah" / "medium.h5")
    batches = recipe(tmp_path, monkeypatch)

    def first_of_two_epochs() -> list[bytes]:
        torch.manual_seed(7)
        loader = torch.utils.data.DataLoader(batches(dataset, 256), None, **options)
        epochs = [list(itertools.islice(loader, 4)) for _ in range(2)]
        return [batch["rewards"].numpy().tobytes() for epoch in epochs for batch in epoch]

    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/medium") as dataset:
            found = first_of_two_epochs()
            assert len(set(found)) == len(found) == 8
            assert first_of_two_epochs() == found


def test_the_recipe_runs_as_it_stands(tmp_path: Path) -> None:
    write_example(tmp_path / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/medium") as dataset:
            names = {"dataset": dataset, "torch": torch}
            exec(program_with("DataLoader"), names)
            assert next(iter(names["loader"]))["observations"].shape == (256, 17)
