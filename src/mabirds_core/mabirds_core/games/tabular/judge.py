"""The judge of enumerable games: probabilities, not samples."""

from collections.abc import Sequence
from dataclasses import dataclass

from mabirds_core.games.interface import ImitationMetrics, TabularGame
from mabirds_core.metrics.metrics import exact_imitation, policy_distance
from mabirds_core.planners.interface import TabularPolicy


@dataclass(frozen=True)
class ExactJudge:
    """Follows the probability mass of a policy through time."""

    game: TabularGame
    method: str = "exact: by following the policy's probability mass, not by sampling"

    def eval_iterations(self, count: int) -> list[int]:
        """Iterations to judge: all, as each takes milliseconds."""
        return list(range(1, count + 1))

    def imitation(self, policy: TabularPolicy, seed: int) -> ImitationMetrics:  # noqa: ARG002 - nothing is drawn
        """CVR and SR of a policy, exactly."""
        return exact_imitation(self.game, policy)

    def distance(self, policies: Sequence[TabularPolicy], seed: int) -> float:  # noqa: ARG002 - nothing is drawn
        """Distance of the policies' occupancy measures."""
        return policy_distance(self.game, policies)
