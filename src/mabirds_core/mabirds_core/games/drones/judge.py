"""The judge of drones: flights, each by its whole way."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.metrics import drone_imitation, flight_distance, place_visitation
from mabirds_core.games.drones.rollouts import DronePolicy, drone_rollouts
from mabirds_core.games.interface import ImitationMetrics, Trajectories

FLIGHTS = 500
"""Flights that judge a policy."""

MAX_EVAL_ITERATIONS = 13
"""Iterations of a learner that are judged; each takes a second."""


@dataclass(frozen=True)
class FlightJudge:
    """Shares of flights of a policy."""

    game: DroneGame
    method: str = f"shares of {FLIGHTS} flights of the policy that theta and omega mean, found anew"

    def eval_iterations(self, count: int) -> list[int]:
        """Iterations to judge, evenly spread over all."""
        return sorted({round(n) for n in np.linspace(1, count, min(count, MAX_EVAL_ITERATIONS))})

    def flights(self, policy: DronePolicy, seed: int, count: int = FLIGHTS) -> Trajectories:
        """Flights of a policy, the same for every learner and iteration but for what it decides."""
        return drone_rollouts(self.game, policy, count, np.random.default_rng([seed, FLIGHTS]))

    def imitation(self, policy: DronePolicy, seed: int) -> ImitationMetrics:
        """CVR and SR of a policy's flights."""
        return drone_imitation(self.game, self.flights(policy, seed))

    def distance(self, policies: Sequence[DronePolicy], seed: int) -> float:
        """Distance of the policies' place visitations."""
        return flight_distance([place_visitation(self.game, self.flights(policy, seed)) for policy in policies])
