"""theta and omega, and one step down a gradient."""

from typing import Literal, NamedTuple

import numpy as np
from pydantic import Field

from mabirds_core.arrays import Vector
from mabirds_core.errors import DivergenceError
from mabirds_core.settings import Settings

LARGEST = 1e12
"""No parameter may be larger: probabilities, which hang on differences of sums of them, would lose their precision."""


class Parameters(NamedTuple):
    """What learners exchange: theta, shape (K_theta,), reward parameters; omega, shape (K_omega,), cost weights."""

    theta: Vector
    omega: Vector


class StepSizes(Settings):
    """The paper's step rule: alpha(n) = alpha / n^eta1 for omega, beta(n) = beta / n^eta2 for theta."""

    kind: Literal["paper"] = "paper"
    alpha: float = Field(gt=0, description="abar: first step of omega")
    beta: float = Field(gt=0, description="bbar: first step of theta")
    eta1: float = Field(0.51, gt=0.5, lt=1, description="decay of alpha")
    eta2: float = Field(0.51, gt=0.5, lt=1, description="decay of beta")

    def at(self, step: int) -> tuple[float, float]:
        """alpha(n), beta(n).

        >>> StepSizes(alpha=8, beta=4, eta1=0.75, eta2=0.75).at(16)
        (1.0, 0.5)
        """
        return self.alpha / step**self.eta1, self.beta / step**self.eta2

    def descend(self, origin: Parameters, gradient: Parameters, step: int) -> Parameters:
        """(theta - beta(n) grad_theta, omega - alpha(n) grad_omega); raises DivergenceError past LARGEST."""
        alpha, beta = self.at(step)
        after = Parameters(origin.theta - beta * gradient.theta, origin.omega - alpha * gradient.omega)
        if not all((np.abs(values) <= LARGEST).all() for values in after):
            raise DivergenceError(f"step {step} carried theta or omega past {LARGEST:g}; lower alpha and beta")
        return after
