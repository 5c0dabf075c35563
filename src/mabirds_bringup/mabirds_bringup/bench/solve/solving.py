"""A solve, and how long it takes."""

from collections.abc import Callable
from time import perf_counter, process_time
from typing import Any

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.games.factored import FactoredGame
from mabirds_core.planners.occupancy import ExactOccupancy
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner
from mabirds_core.rewards.models import LinearReward


def fastest(work: Callable[[], Any], seconds: float = 1.0, most: int = 200) -> float:
    """Processor time of the fastest of as many repetitions as fit, at least three; in milliseconds."""
    times, start = list[float](), perf_counter()
    while len(times) < 3 or (perf_counter() - start < seconds and len(times) < most):
        before = process_time()
        work()
        times.append(process_time() - before)
    return 1e3 * min(times)


def solve(game: FactoredGame, theta: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """What a learner does at an iteration: policy, expectations, totals of the features."""
    model = LinearReward(game.reward_features)
    policy = SoftBellmanPlanner(game, model, game.cost_features).plan(theta, omega)
    visitation = ExactOccupancy(game)(policy, np.random.default_rng(0))
    return model.gradient(theta, visitation), game.cost_features.total(visitation)
