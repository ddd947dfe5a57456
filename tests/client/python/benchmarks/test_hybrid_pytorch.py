"""The learner in PyTorch, and that its saved agent acts as it does."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType, SimpleNamespace

import b4mrl
import numpy as np
import pytest

from made_dataset import rows_recorded_by
from test_benchmark import HIDDEN
from test_suites import EXAMPLES, run_learner

pytest.importorskip("torch", reason="PyTorch is not installed")

UPDATES = 400


def learner() -> ModuleType:
    spec = importlib.util.spec_from_file_location("hybrid", EXAMPLES / "hybrid_pytorch.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_learner_in_pytorch_leaves_an_agent_of_both_sources(
    medium: b4mrl.Client, tmp_path: Path
) -> None:
    used = run_learner(medium, tmp_path, EXAMPLES / "hybrid_pytorch.py", updates=UPDATES)
    assert used.steps == UPDATES  # one in the simulator for each update
    assert UPDATES * 128 <= used.dataset_rows <= (UPDATES + 4) * 128  # some are asked for ahead
    scores = medium.benchmark(HIDDEN).evaluate(tmp_path / "agent.h5", episodes=2)
    assert np.isfinite(scores.returns).all()


def test_the_learner_in_pytorch_takes_observations_that_are_tables(client: b4mrl.Client) -> None:
    hybrid = learner()
    with client.make_vec("Highway", hybrid.LANES, seed=1) as vec:
        bench = SimpleNamespace(make_simulator=lambda lanes, seed: vec)
        rollouts = hybrid.Rollouts(bench, 2 * hybrid.LANES, np.random.default_rng(0))
        size, actions = vec.session.spec.observation.size, vec.session.spec.action.size
        mask = np.arange(size).reshape(5, 5) != 3
        actor = hybrid.Actor(np.zeros(size), np.ones(size), mask, actions)
        rollouts.step(actor)
        assert rollouts.sample(4)["next_observations"].shape == (4, size)
        assert actor.act(vec.reset(seed=1)[0]).shape == (hybrid.LANES, actions)


def test_pytorch_and_the_programs_act_alike(medium: b4mrl.Client, tmp_path: Path) -> None:
    bench, agent = medium.benchmark(HIDDEN), tmp_path / "agent.h5"
    actor = learner().train(bench, seed=0, updates=UPDATES)
    actor.save(agent, bench, 0, UPDATES)
    rows = rows_recorded_by(agent, tmp_path / "data")
    # Three layers in float32, whose sums have another order in each library.
    np.testing.assert_allclose(actor.act(rows["observations"]), rows["actions"], atol=1e-5)
    saved = b4mrl.load_agent(agent)(rows["observations"])
    np.testing.assert_allclose(saved, rows["actions"], atol=1e-5)
