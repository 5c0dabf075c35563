"""Other numbers of experts and learners and other maps, from settings alone."""

from pathlib import Path

import numpy as np
import pytest
from experiments import demonstrations, experiment

from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.metrics.metrics import exact_imitation

CONFIG = Path(__file__).resolve().parents[2] / "ros_ws" / "config"

TRIO = {
    "game": {
        "map": "...\n...",
        "starts": [[[0, 0], [0, 2], [1, 1]]],
        "goals": [[0, 1], [1, 2], [1, 0]],
        "horizon": 4,
        "discount": 0.9,
    },
    "algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "exact"},
}


@pytest.mark.parametrize("count", [2, 3, 8])
def test_three_experts_are_learned_by_any_number_of_learners(count: int) -> None:
    names = [f"learner_{number}" for number in range(count)]
    settings = experiment({**TRIO, "learners": names, "schedule": {"kind": "alternating"}, "iterations": 12})
    game = build_game(settings)
    assert game.n_experts == 3
    history = simulate(settings, demonstrations(settings))
    for name in names:
        policy = evaluation_policy(settings, name, game)
        first, last = (exact_imitation(game, policy(history[name][n])).violation_rate for n in (0, -1))
        assert last < first / 2
    final = np.array([history[name][-1].omega for name in names])
    assert np.abs(final - final.mean(axis=0)).max() < np.abs(final).max() / 2


def test_three_experts_swap_and_share_in_pairs() -> None:
    game = build_game(experiment(TRIO))
    assert len(game.cost_features.names) == 3 * 6 + 2
    assert game.sharing.max() == 3


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_shipped_experiment_can_be_read(file: Path) -> None:
    assert load_experiment(file).name == file.stem
