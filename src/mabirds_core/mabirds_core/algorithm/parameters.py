"""theta and omega, and one step from where a learner stands."""

from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.errors import DivergenceError

MAX_PARAMETER = 1e12
"""No parameter may be larger: probabilities, which hang on differences of sums of them, would lose their precision."""


class Parameters(NamedTuple):
    """What learners exchange.

    Attributes
    ----------
    theta : Vector
        Reward parameters, shape (K_theta,).
    omega : Vector
        Cost weights, shape (K_omega,).
    """

    theta: Vector
    omega: Vector


def scaled(factor: float, parameters: Parameters) -> Parameters:
    """Multiply both by a number.

    Parameters
    ----------
    factor : float
        The number.
    parameters : Parameters
        theta and omega.

    Returns
    -------
    product : Parameters
        factor * theta, factor * omega.
    """
    return Parameters(factor * parameters.theta, factor * parameters.omega)


def descend(origin: Parameters, step: Parameters, n: int) -> Parameters:
    """Return origin - step.

    Parameters
    ----------
    origin : Parameters
        Where the step begins: what mixing left.
    step : Parameters
        What is taken off; a step rule's.
    n : int
        Number of the step, for the error.

    Returns
    -------
    after : Parameters
        The difference.

    Raises
    ------
    DivergenceError
        Where a parameter would be larger than MAX_PARAMETER, or no number.
    """
    after = Parameters(origin.theta - step.theta, origin.omega - step.omega)
    if not all((np.abs(values) <= MAX_PARAMETER).all() for values in after):
        raise DivergenceError(
            f"step {n} carried theta or omega past {MAX_PARAMETER:g}; lower alpha and beta, or leave out steps"
        )
    return after
