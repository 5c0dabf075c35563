"""What networks are told to cost by distance, and that they find a distance that costs, of which nobody tells them."""

from itertools import product
from math import dist
from pathlib import Path

import numpy as np
import pytest
from games import alone, hallway
from network_costs import some_omega, with_network

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.patrol.cost_shapes import by_distance, cost_measures
from mabirds_core.games.patrol.game import PatrolGame

SPACING = Path(__file__).parents[3] / "ros_ws" / "config" / "spacing.yaml"


def test_numbers_are_sorted_by_the_distance_of_the_nearest_two() -> None:
    game = hallway()
    of_states = np.random.default_rng(0).normal(size=game.n_states)
    cells = [*product(range(2), range(3))]
    found = by_distance(game, of_states)
    for k, apart in enumerate(found.apart):
        own = [of_states[s] for s, (a, b) in enumerate(product(cells, repeat=2)) if abs(dist(a, b) - apart) < 1e-12]
        assert (found.mean[k], found.least[k], found.most[k]) == pytest.approx((np.mean(own), min(own), max(own)))
    assert found.apart.tolist() == pytest.approx([0, 1, 2**0.5, 2, 5**0.5])


def test_measures_are_of_networks_alone() -> None:
    game, costs = with_network(PatrolGame(hallway().settings.model_copy(update={"true_cost": "2 * (distance < 1)"})))
    omega = some_omega(costs)
    found = cost_measures(game, omega)
    assert found["true_cost"] == {f"{x:.2f} cells": 2.0 * (x == 0) for x in (0, 1, 2**0.5, 2, 5**0.5)}
    assert min(found["learned_cost"].values()) == 0
    assert sum(found["cost_variance"].values()) == pytest.approx(costs.of_states(omega).var())
    plain = hallway()
    assert cost_measures(plain, np.zeros(len(plain.cost_features.names))) == {}
    assert cost_measures(with_network(alone())[0], omega) == {}


def test_a_network_finds_the_distance_that_costs_which_is_neither_the_nearest_nor_the_farthest() -> None:
    experiment = load_experiment(SPACING).model_copy(update={"iterations": 400})
    game = build_game(experiment)
    experts, rng = game.experts("soft", "by_start"), np.random.default_rng(1)
    streams = {name: list(experts.demonstrations(400, rng)) for name in experiment.learners}
    last = simulate(experiment, streams)["learner_1"][-1]
    measures = game.measures(last.omega, streams["learner_1"][0])
    learned = {float(name.split()[0]): value for name, value in measures["learned_cost"].items()}
    dearest = max(cost for apart, cost in learned.items() if 1.9 < apart < 2.3)
    assert dearest > 1.2
    assert dearest > learned[1.0] + 0.5
    assert all(dearest > cost + 0.8 for apart, cost in learned.items() if apart >= 3)
