"""A central method to compare with: what no demonstration has ever touched costs ``penalty``, and nothing else does."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.baselines.interface import CentralState, MethodParts
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.registry import Kind
from mabirds_core.settings import Settings


class UntouchedSettings(Settings):
    """Forbidden is what no demonstration has ever touched."""

    penalty: float = Field(5.0, gt=0, le=1000, description="cost of a feature that no demonstration touches")


@dataclass(frozen=True)
class Untouched:
    """theta stays as it is at first: the method learns constraints alone."""

    estimator: GradientEstimator
    penalty: float
    seed: int

    def initial_state(self) -> CentralState:
        """theta(1) of the reward model, omega(1) = 0."""
        return CentralState(1, self.estimator.initial_parameters(self.seed), memory=())

    def update(self, state: CentralState, demonstrations: Trajectories) -> CentralState:
        """omega_k = -penalty for every feature that all demonstrations so far leave at 0."""
        seen, game = (demonstrations, *state.memory), self.estimator.game
        touched = game.cost_features.total(discounted_visitation(stacked(seen), game.discount)) > 0
        omega = np.where(touched, 0.0, -self.penalty)
        after = Parameters(state.parameters.theta, omega)
        return CentralState(state.iteration + 1, after, memory=seen, work=state.work.more(1, 0))


def build_untouched(settings: UntouchedSettings, parts: MethodParts) -> Untouched:
    """The method of the settings."""
    return Untouched(parts.estimator(parts.reward), settings.penalty, parts.seed)


UNTOUCHED = Kind(UntouchedSettings, build_untouched)
