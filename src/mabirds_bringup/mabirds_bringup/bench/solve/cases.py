"""Games of growing size to be solved, and what is asked of each."""

from dataclasses import dataclass, field
from typing import cast

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.factored import FactoredGame


@dataclass(frozen=True)
class SolveCase:
    """An empty map on which experts walk from corner to corner.

    Attributes
    ----------
    side : int
        Rows, and columns.
    n_experts : int
        N_E, at most 4.
    horizon : int
        T.
    at_most : dict[str, float]
        Limits on what is measured, by name.
    reference : bool
        Is the readable reference solved beside it?
    peer : bool
        Are dense transitions solved by the ``imitation`` package, where that is installed?
    """

    side: int
    n_experts: int
    horizon: int
    at_most: dict[str, float] = field(default_factory=dict)
    reference: bool = False
    peer: bool = False

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.n_experts} experts {self.side}x{self.side} T {self.horizon}"

    @property
    def game(self) -> FactoredGame:
        """The game: the default one, in which experts walk on a map."""
        end = self.side - 1
        corners = [(0, 0), (end, end), (0, end), (end, 0)]
        settings = {
            "map": "\n".join(["." * self.side] * self.side),
            "starts": [corners[: self.n_experts]],
            "goals": [*corners[1 : self.n_experts], corners[0]],
            "horizon": self.horizon,
        }
        experiment = {
            "name": "solve",
            "game": settings,
            "iterations": 1,
            "learners": ["one"],
            "schedule": {"kind": "static"},
        }
        bag = {"demonstrations": {"bag": "none", "per_learner": 1}}
        return cast("FactoredGame", build_game(Experiment.model_validate({**experiment, **bag})))


def weights(game: FactoredGame) -> tuple[Vector, Vector]:
    """theta and omega of some nats, all features and meetings costing something."""
    rng = np.random.default_rng(1)
    theta = rng.normal(size=len(game.reward_features.names))
    return theta, -rng.exponential(size=len(game.cost_features.names))


CASES = (
    SolveCase(5, 2, 30, {}, reference=True, peer=True),
    SolveCase(8, 2, 30, {"milliseconds": 3.0}, reference=True),
    SolveCase(10, 2, 30, {"times_of_bandwidth_limit": 4.0}, reference=True),
    SolveCase(20, 2, 60, {"milliseconds": 350.0}),
    SolveCase(5, 3, 30, {}, reference=True),
    SolveCase(8, 3, 10, {"milliseconds": 500.0, "megabytes": 300.0}),
)
SMALL = (SolveCase(5, 2, 15, {"share_of_reference": 0.5}, reference=True, peer=True),)
"""Ratios alone, which hold on any machine."""

ITERATIONS = {
    "ros_ws/config/discrete.yaml": {"milliseconds": 15.0},
    "ros_ws/config/patrol.yaml": {"milliseconds": 3.0},
    "ros_ws/config/drones.yaml": {"milliseconds": 500.0},
}
"""Limits on a learner's iteration in the shipped experiments, which the package has in its folder config."""

MOST_UPDATES = 120
"""Of all learners together: all of some experiments would take minutes."""
