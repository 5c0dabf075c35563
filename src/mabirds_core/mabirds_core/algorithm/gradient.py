"""The gradient of G at theta, omega: what the found policy does minus what was demonstrated (paper, section 4).

    grad_theta = E_pi grad J(zeta) - mean_i grad J(zeta_i)
    grad_omega = E_pi mu(zeta)     - mean_i mu(zeta_i),         pi = pi(omega, theta)

One policy is found for it, and its expectation is an average over rollouts or the occupancy measure itself.
Learners and central methods alike descend along it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories, discounted_visitation
from mabirds_core.planners.interface import OccupancyEstimator, Planner, Policy
from mabirds_core.rewards.models import RewardModel

RolloutStart = Literal["initial", "demonstration"]


class GradientEstimate(NamedTuple):
    """The gradient, and the policy that was found for it."""

    gradient: Parameters
    policy: Policy


@dataclass(frozen=True)
class GradientEstimator:
    """Steps 1 and 2 of Algorithm 1 and the differences of its step 4.

    ``rollout_start``: "initial" rolls out from P_0 as the paper does; "demonstration" from the states in which the
    observed demonstrations began, which has the same mean and removes the variance that P_0 brings in.
    """

    game: ConstrainedMarkovGame
    reward: RewardModel
    planner: Planner
    expectation: OccupancyEstimator
    rollout_start: RolloutStart = "initial"

    def initial_parameters(self, seed: int) -> Parameters:
        """theta(1) of the reward model, the same for all who share the seed; omega(1) = 0."""
        theta = self.reward.initial(np.random.default_rng(seed))
        return Parameters(theta, np.zeros(len(self.game.cost_features.names)))

    def __call__(
        self,
        parameters: Parameters,
        demonstrations: Trajectories,
        rng: np.random.Generator,
        previous: Policy | None = None,
    ) -> GradientEstimate:
        """The gradient for the mean of ``demonstrations``; ``previous``: the policy to start the search from."""
        policy = self.planner.plan(*parameters, previous, rng, demonstrations)
        starts = demonstrations.states[:, 0] if self.rollout_start == "demonstration" else None
        imagined = self.expectation(policy, rng, starts)
        observed = discounted_visitation(demonstrations, self.game.discount)
        grad_j, features = self.reward.gradient, self.game.cost_features
        return GradientEstimate(
            Parameters(
                grad_j(parameters.theta, imagined) - grad_j(parameters.theta, observed),
                features.total(imagined) - features.total(observed),
            ),
            policy,
        )


def stacked(demonstrations: Sequence[Trajectories]) -> Trajectories:
    """Several sets of trajectories as one."""
    return Trajectories(
        np.concatenate([trajectories.states for trajectories in demonstrations]),
        np.concatenate([trajectories.actions for trajectories in demonstrations]),
    )
