"""Drones judged by flights that nobody learned from, where no truth is known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.forecasts import PolicyForecast, forecasts
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePolicy
from mabirds_core.games.drones.rewards import TrueDroneReward
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Forecast
from mabirds_core.metrics.displacement import displacements

STEP_COSTS = np.geomspace(0.25, 16.0, 7)
"""That are tried for drones which know their goals and nothing else, in units of the temperature."""


@dataclass(frozen=True)
class HeldOutFlights:
    """How flights are compared with flights that were held out."""

    game: DroneGame
    evaluation_planner: Callable[[Any, Any], Any]
    """From settings of a planner and a reward to the planner that judges."""

    def of_policy(self, policy: LatticePolicy) -> Forecast:
        """A learned policy as a forecast."""
        return PolicyForecast(policy)

    def baselines(self, policy: LatticePolicy, planner: Any, training: Trajectories) -> Mapping[str, Forecast]:
        """What is to be beaten.

        Parameters
        ----------
        policy : LatticePolicy
            A learned one, whose lattice all are told on.
        planner : Any
            Settings of the planner of this policy.
        training : Trajectories
            From which their numbers are taken.

        Returns
        -------
        Mapping[str, Forecast]
            By name: uniform, maximum entropy without learning, and those of ``forecasts``.
        """
        plans = {cost: self._goals_told(planner, float(cost)) for cost in (0.0, *STEP_COSTS)}
        uniform = plans.pop(0.0)
        likeliest = max(plans.values(), key=lambda plan: float(plan.log_ratios(training).mean()))
        return {
            "uniform": uniform,
            "maximum entropy, goals told": likeliest,
            **forecasts(policy, training),
        }

    def _goals_told(self, planner: Any, step_cost: float) -> PolicyForecast:
        """The policy of drones that pay for every step until they have arrived, in units of the temperature."""
        settings = self.game.settings.model_copy(update={"step_cost": step_cost * planner.temperature})
        reward = TrueDroneReward(DroneGame(settings))
        nothing = np.zeros(len(self.game.cost_features.names))
        return PolicyForecast(self.evaluation_planner(planner, reward).plan(np.empty(0), nothing))

    def steps(self, demonstrations: Trajectories) -> Vector:
        """Steps until all drones have arrived, of each demonstration, shape (m,)."""
        return np.asarray((~self.game.arrived(demonstrations.states).all(axis=-1)).sum(axis=1), dtype=np.float64)

    def displacements(self, demonstrations: Trajectories, flown: Trajectories, count: int) -> tuple[Array, Array]:
        """Distances of flights to what was shown.

        Parameters
        ----------
        demonstrations : Trajectories
            m of them.
        flown : Trajectories
            ``count`` from each start, those of the first start first.
        count : int
            k.

        Returns
        -------
        tuple[Array, Array]
            Mean over drones and steps until the drone shown has arrived, and mean over drones at that step or the
            last one; shape (m, k) each [m].
        """
        shown, places = (self.game.positions(of.states) for of in (demonstrations, flown))
        return displacements(shown, places, ~self.game.arrived(demonstrations.states), count)

    def conflicts(self, trajectories: Trajectories) -> Mapping[str, float]:
        """Shares of trajectories that come closer than least_distance, and that touch what the settings have."""
        clearance = self.game.separation_clearance(trajectories.states)
        found = {"too close": float((clearance < 0).any(axis=1).mean())}
        if self.game.settings.barriers:
            touching = self.game.obstacle_clearance(trajectories.states) < 0
            found["touching"] = float(touching.any(axis=(1, 2)).mean())
        return found
