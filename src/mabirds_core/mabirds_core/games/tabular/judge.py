"""The judge of enumerable games: probabilities, not samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import ShownFeatures, Trajectories
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.tabular.constraint_test import KnownChances, NeutralGame, constraint_confidences
from mabirds_core.metrics.likelihood import log_likelihoods
from mabirds_core.metrics.metrics import exact_imitation, largest_distance
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.occupancy import occupancy_measure
from mabirds_core.recent import Recent
from mabirds_core.rewards.models import TabularRewardModel

KEPT = 4
"""Occupancy measures of living policies that are kept: the experts', and those of what learners ended with."""


@dataclass(frozen=True)
class ExactJudge:
    """Follows the probability mass of a policy through time."""

    game: NeutralGame
    _occupancies: Recent[Array] = field(default_factory=lambda: Recent(KEPT), compare=False, repr=False)
    _chances: KnownChances = field(default_factory=KnownChances, compare=False, repr=False)
    method: str = "exact: by following the policy's probability mass, not by sampling"

    def eval_iterations(self, count: int) -> list[int]:
        """Iterations to judge: all, as each takes milliseconds."""
        return list(range(1, count + 1))

    def imitation(self, policy: TabularPolicy, seed: int, rollouts: int | None = None) -> ImitationMetrics | None:  # noqa: ARG002 - nothing is drawn
        """CVR and SR of a policy, exactly; None where nobody knows the true constraints."""
        if self.game.true_constraints is None:
            return None
        return exact_imitation(self.game, policy)

    def distance(self, policies: Sequence[TabularPolicy], seed: int, rollouts: int | None = None) -> float:  # noqa: ARG002 - nothing is drawn
        """Distance of the policies' occupancy measures."""
        return largest_distance([self.occupancy(policy) for policy in policies])

    def occupancy(self, policy: TabularPolicy) -> Array:
        """rho(s, a) of a policy, shape (S, A), found once."""
        return self._occupancies.get(policy, lambda: occupancy_measure(self.game, policy))

    def distance_to(self, policy: TabularPolicy, demonstrations: Trajectories, seed: int) -> None:
        """None: the experts' policy is at hand."""

    def log_likelihoods(self, policy: TabularPolicy, demonstrations: Trajectories) -> Vector:
        """log p of each demonstration while it is under way."""
        return log_likelihoods(self.game, policy, demonstrations)

    def fixed_log_likelihoods(self, policy: TabularPolicy, demonstrations: Trajectories) -> Mapping[str, float]:  # noqa: ARG002
        """None: the experts' own likelihood is at hand."""
        return {}

    def value(self, policy: TabularPolicy, seed: int) -> None:
        """None: rates are found from the policy itself."""

    def certificate(self, policy: TabularPolicy, seed: int) -> None:
        """None: rates are found from the policy itself, whoever planned it."""

    def constraint_confidences(
        self, reward: TabularRewardModel, parameters: Parameters, shown: ShownFeatures
    ) -> Vector:
        """By the counterfactual test."""
        return constraint_confidences(self.game, reward, parameters, shown, self._chances)
