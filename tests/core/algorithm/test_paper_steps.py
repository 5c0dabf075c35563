"""The paper's step rule: its decay, its range, and that it remembers nothing."""

import numpy as np
import pytest
from pydantic import ValidationError

from mabirds_core.algorithm.gradient import Counts, GradientEstimate
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.algorithm.parameters import Parameters

STEPS = PaperSteps(alpha=3.0, beta=0.7, eta1=0.6, eta2=0.9)


def estimate(window_fill: float = 1.0) -> GradientEstimate:
    """Of gradients (2, -1) in theta and (0.5,) in omega."""
    imagined, observed = (
        Parameters(np.array([3.0, 1.0]), np.array([1.0])),
        Parameters(np.array([1.0, 2.0]), np.array([0.5])),
    )
    return GradientEstimate(imagined, observed, None, Counts(True, True), 10.0, window_fill)


def test_the_step_of_omega_decays_with_eta1_and_that_of_theta_with_eta2() -> None:
    assert STEPS.at(1) == (3.0, 0.7)
    assert STEPS.at(7) == pytest.approx((3.0 / 7**0.6, 0.7 / 7**0.9), rel=1e-15)


@pytest.mark.parametrize("n", [1, 2, 50])
def test_a_step_is_alpha_and_beta_times_the_gradient(n: int) -> None:
    step, _ = STEPS.step({}, estimate(), n)
    np.testing.assert_allclose(step.theta, 0.7 / n**0.9 * np.array([2.0, -1.0]), rtol=1e-15)
    np.testing.assert_allclose(step.omega, [3.0 / n**0.6 * 0.5], rtol=1e-15)


def test_while_the_window_fills_a_step_is_the_filled_share() -> None:
    part, whole = STEPS.step({}, estimate(0.25), 4)[0], STEPS.step({}, estimate(), 4)[0]
    np.testing.assert_array_equal(part.theta, 0.25 * whole.theta)
    np.testing.assert_array_equal(part.omega, 0.25 * whole.omega)


def test_it_remembers_nothing() -> None:
    state = STEPS.initial(Parameters(np.zeros(2), np.zeros(1)))
    assert state == {}
    assert STEPS.step(state, estimate(), 3)[1] == {}


@pytest.mark.parametrize("wrong", [{"alpha": 0}, {"beta": -1}, {"eta1": 0.5}, {"eta2": 1}, {"alpha": np.nan}])
def test_step_sizes_outside_the_assumptions_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        PaperSteps.model_validate({"alpha": 1, "beta": 1, **wrong})
