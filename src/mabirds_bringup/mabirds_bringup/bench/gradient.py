"""How near what was learned is to a point where the loss falls no further."""

from dataclasses import replace
from typing import Any

import numpy as np

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_core.games.interface import Visitation, discounted_visitation
from mabirds_core.planners.interface import Policy

ROLLOUTS = 1000
"""Of each plan. With as many as learners take, chance alone would be half of what is left."""


def gradient_norm(
    experiment: Experiment, name: str, parameters: Parameters, policy: Policy, streams: Streams
) -> float | None:
    """Norm of the gradient of the loss on the demonstrations of all, E_pi less their mean, in discounted visits.

    Where a planner draws a lattice for every plan, the loss is the mean over the lattices, and so is its gradient.

    Parameters
    ----------
    experiment : Experiment
        Whose expectations are of rollouts.
    name : str
        Of the learner.
    parameters : Parameters
        theta and omega that it ended with.
    policy : Policy
        Which they mean, where the planner draws none.
    streams : Streams
        The demonstrations of each learner.

    Returns
    -------
    float or None
        Over theta and omega together; None of methods, and where expectations are exact.
    """
    if name not in experiment.learners:
        return None
    estimator = build_learner(experiment, name).estimator
    expectation: Any = estimator.expectation
    if not hasattr(expectation, "count"):
        return None
    shown = stacked([demonstration for stream in streams.values() for demonstration in stream])
    rng, starts = np.random.default_rng(experiment.seed), shown.states[:, 0]

    def counts(visitation: Visitation) -> Vector:
        rewards, costs = estimator.reward.gradient(parameters.theta, visitation), estimator.costs
        return np.concatenate([rewards, costs.gradient_of_total(parameters.omega, costs.total(visitation))])

    followed, every_plan = replace(expectation, count=ROLLOUTS), getattr(estimator.planner, "every_plan", None)
    plans = every_plan(*parameters) if every_plan else [policy]
    expected = np.mean([counts(followed(plan, rng, starts)) for plan in plans], axis=0)
    return float(np.linalg.norm(expected - counts(discounted_visitation(shown, estimator.game.discount))))
