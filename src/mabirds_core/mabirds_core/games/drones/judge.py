"""The judge of drones: rollouts, each by its whole way."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.metrics import drone_imitation, place_visitation, visitation_distance
from mabirds_core.games.drones.rollouts import DronePolicy, drone_rollouts
from mabirds_core.games.interface import ShownFeatures, Trajectories
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.recent import Recent

EVAL_ROLLOUTS = 500
"""Rollouts that judge a policy."""

MAX_EVAL_ITERATIONS = 13
"""Iterations of a learner that are judged; each takes a second."""


CERTIFIED = 16
"""Flights along which the value of a policy is checked."""

KEPT = 8
"""Living policies of which rollouts are kept."""


@dataclass(frozen=True)
class RolloutJudge:
    """Shares of rollouts of a policy."""

    game: DroneGame
    _flights: Recent[dict[tuple[int, int], Trajectories]] = field(
        default_factory=lambda: Recent(KEPT), compare=False, repr=False
    )
    method: str = f"shares of {EVAL_ROLLOUTS} rollouts of the policy that theta and omega mean, found anew"

    def eval_iterations(self, count: int) -> list[int]:
        """Iterations to judge, evenly spread over all."""
        return sorted({round(n) for n in np.linspace(1, count, min(count, MAX_EVAL_ITERATIONS))})

    def rollouts(self, policy: DronePolicy, seed: int, count: int = EVAL_ROLLOUTS) -> Trajectories:
        """Roll out a policy, once, alike for every learner and iteration but for what it decides.

        Parameters
        ----------
        policy : DronePolicy
            pi_t(a | s).
        seed : int
            Of the rollouts.
        count : int, optional
            How many.

        Returns
        -------
        Trajectories
            From P_0.
        """
        drawn = self._flights.get(policy, dict)
        if (seed, count) not in drawn:
            drawn[seed, count] = drone_rollouts(self.game, policy, count, np.random.default_rng([seed, EVAL_ROLLOUTS]))
        return drawn[seed, count]

    def imitation(self, policy: DronePolicy, seed: int, rollouts: int | None = None) -> ImitationMetrics | None:
        """CVR and SR of a policy's rollouts; None where nobody knows what violates."""
        if self.game.true_constraints is None:
            return None
        return drone_imitation(self.game, self.rollouts(policy, seed, rollouts or EVAL_ROLLOUTS))

    def distance(self, policies: Sequence[DronePolicy], seed: int, rollouts: int | None = None) -> float:
        """Distance of the policies' place visitations."""
        drawn = (self.rollouts(policy, seed, rollouts or EVAL_ROLLOUTS) for policy in policies)
        return visitation_distance([place_visitation(self.game, trajectories) for trajectories in drawn])

    def distance_to(self, policy: DronePolicy, demonstrations: Trajectories, seed: int) -> float:
        """Distance of the places that a policy's rollouts visit to those of demonstrations."""
        drawn = self.rollouts(policy, seed), demonstrations
        return visitation_distance([place_visitation(self.game, trajectories) for trajectories in drawn])

    def log_likelihoods(self, policy: Any, demonstrations: Trajectories) -> Vector | None:
        """Nats by which demonstrations are likelier than under the uniform policy; None for densities of networks."""
        if not hasattr(policy, "choices"):
            return None
        from mabirds_core.games.drones.demonstrated import log_ratios  # needs scipy, which only lattices need

        return log_ratios(policy, demonstrations)

    def fixed_log_likelihoods(self, policy: Any, demonstrations: Trajectories) -> dict[str, float]:
        """Of the uniform policy, 0, and of straight flight with fitted noise."""
        if not hasattr(policy, "choices"):
            return {}
        from mabirds_core.games.drones.demonstrated import straight_log_ratios

        return {"uniform": 0.0, "straight flight": float(straight_log_ratios(policy, demonstrations).mean())}

    def value(self, policy: Any, seed: int) -> float | None:
        """Mean over the starts of rollouts; networks have none."""
        if not hasattr(policy, "values"):
            return None
        return float(policy.values(0, self.game.starts(EVAL_ROLLOUTS, np.random.default_rng(seed))).mean())

    def certificate(self, policy: Any, seed: int) -> float | None:
        """Over a few flights; networks have none."""
        if not hasattr(policy, "residuals"):
            return None
        return float(np.abs(policy.residuals(self.rollouts(policy, seed, CERTIFIED))).max())

    def constraint_confidences(self, reward: Any, parameters: Any, shown: ShownFeatures) -> None:
        """No test yet: constraints are told by the threshold."""
