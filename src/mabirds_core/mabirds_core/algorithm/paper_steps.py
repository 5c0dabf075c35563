"""The paper's step rule: alpha(n) = alpha / n^eta1 for omega, beta(n) = beta / n^eta2 for theta (Algorithm 1)."""

from typing import Literal

from pydantic import Field

from mabirds_core.algorithm.gradient import GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RuleState
from mabirds_core.arithmetic import power
from mabirds_core.settings import Settings


class PaperSteps(Settings):
    """Steps along the gradient that decay with n, the two numbers given per experiment."""

    kind: Literal["paper"] = "paper"
    alpha: float = Field(gt=0, description="abar: first step of omega")
    beta: float = Field(gt=0, description="bbar: first step of theta")
    eta1: float = Field(0.51, gt=0.5, lt=1, description="decay of alpha")
    eta2: float = Field(0.51, gt=0.5, lt=1, description="decay of beta")

    def at(self, n: int) -> tuple[float, float]:
        """alpha(n), beta(n).

        >>> [round(step, 12) for step in PaperSteps(alpha=8, beta=4, eta1=0.75, eta2=0.75).at(16)]
        [1.0, 0.5]
        """
        return self.alpha / power(n, self.eta1), self.beta / power(n, self.eta2)

    def initial(self, parameters: Parameters) -> RuleState:  # noqa: ARG002 - nothing is remembered
        """Nothing is remembered."""
        return {}

    def step(self, state: RuleState, estimate: GradientEstimate, n: int) -> tuple[Parameters, RuleState]:
        """beta(n) grad_theta, alpha(n) grad_omega."""
        alpha, beta = self.at(n)
        gradient = estimate.gradient
        return Parameters(beta * gradient.theta, alpha * gradient.omega), state

    def reveal(
        self, state: RuleState, step: Parameters, estimate: GradientEstimate, n: int
    ) -> tuple[Parameters, RuleState]:
        """Undo ``step``: what was demonstrated is what was expected, less the step over its rate."""
        alpha, beta = (rate * estimate.window_fill for rate in self.at(n))
        theta = estimate.imagined.theta - step.theta / beta
        return Parameters(theta, estimate.imagined.omega - step.omega / alpha), state
