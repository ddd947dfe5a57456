"""The recipe of the README for PyTorch's DataLoader."""

from __future__ import annotations

import itertools
from pathlib import Path

import b4mrl
import numpy as np
import pytest

from test_dataset import write_example
from test_documents import program_with

torch = pytest.importorskip("torch", reason="PyTorch is not installed")


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_a_data_loader_draws_from_a_dataset(
    tmp_path: Path, context: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_example(tmp_path / "HalfCheetah" / "medium.h5")
    # Workers that are spawned import the class by its module's name.
    (tmp_path / "recipe.py").write_text(
        "import torch\n" + program_with("DataLoader").split("\n\n\n")[0]
    )
    monkeypatch.syspath_prepend(tmp_path)
    from recipe import Batches

    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/medium") as dataset:
            loader = torch.utils.data.DataLoader(
                Batches(dataset, 256), None, num_workers=2, multiprocessing_context=context
            )
            batches = list(itertools.islice(loader, 4))
            for i, batch in enumerate(batches):
                wanted = dataset.sample(256, seed=i % 2, batch=i // 2)
                np.testing.assert_array_equal(batch["rewards"].numpy(), wanted["rewards"])


def test_the_recipe_runs_as_it_stands(tmp_path: Path) -> None:
    write_example(tmp_path / "HalfCheetah" / "medium.h5")
    with b4mrl.serve(data=tmp_path) as endpoint, b4mrl.connect(endpoint) as client:
        with client.dataset("HalfCheetah/medium") as dataset:
            names = {"dataset": dataset, "torch": torch}
            exec(program_with("DataLoader"), names)
            assert next(iter(names["loader"]))["observations"].shape == (256, 17)
