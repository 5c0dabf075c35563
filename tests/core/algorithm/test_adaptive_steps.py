"""The default step rule against its formulas coordinate by coordinate, and what makes its steps need no numbers."""

from collections.abc import Callable
from math import log, sqrt

import numpy as np
import pytest
from experiments import experiment
from pydantic import ValidationError

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.gradient import Counts, GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RuleState
from mabirds_core.arrays import Vector
from mabirds_core.experiment.learning_settings import AlgorithmSettings

RULE, MASS = AdaptiveSteps(), 16.0
COUNTS = Counts(theta=True, omega=True)
SIGNED = Counts(theta=False, omega=False)
MIXED = Counts(theta=False, omega=True)
OF_SOME = Counts(theta=np.arange(7) >= 5, omega=False)
"""As of drones, whose lateness is a count."""
PRIORS = {"theta": 0.1, "omega": 0.001}

every_kind = pytest.mark.parametrize("counts", [COUNTS, SIGNED, MIXED, Counts(True, False)])


def estimate(
    imagined: Parameters, observed: Parameters, counts: Counts = COUNTS, window_fill: float = 1.0
) -> GradientEstimate:
    return GradientEstimate(imagined, observed, None, counts, MASS, window_fill)


def dense_counts(seed: int) -> Parameters:
    """More than one of theta's and one of omega's features are active per step and expert."""
    return Parameters(*(values + MASS for values in some_counts(seed)))


def some_counts(seed: int, sizes: tuple[int, int] = (7, 4)) -> Parameters:
    """Of theta's and omega's features, some of them 0."""
    rng = np.random.default_rng(seed)
    return Parameters(*(rng.exponential(size=size) * rng.integers(0, 2, size) for size in sizes))


def some_estimates(
    counts: Counts, number: int = 12, window_fill: float = 1.0, make: Callable[[int], Parameters] = some_counts
) -> list[GradientEstimate]:
    return [estimate(make(2 * n), make(2 * n + 1), counts, window_fill) for n in range(number)]


def steps_of(estimates: list[GradientEstimate]) -> list[Parameters]:
    """One after the other, from n = 1."""
    state = RULE.initial(estimates[0].imagined)
    steps = []
    for n, each in enumerate(estimates, start=1):
        step, state = RULE.step(state, each, n)
        steps.append(step)
    return steps


def literal_steps(estimates: list[GradientEstimate]) -> list[dict[str, list[float]]]:
    """The docstring's formulas, number by number."""
    momenta: dict[tuple[str, int], float] = {}
    squares: dict[tuple[str, int], float] = {}
    steps = []
    for n, each in enumerate(estimates, start=1):
        counted = {
            (name, k)
            for name in ("theta", "omega")
            for k, count in enumerate(np.broadcast_to(getattr(each.counts, name), getattr(each.observed, name).shape))
            if count
        }
        active = sum(float(getattr(each.observed, name)[k]) for name, k in counted) / each.mass
        step: dict[str, list[float]] = {"theta": [], "omega": []}
        for name in ("theta", "omega"):
            pairs = zip(getattr(each.imagined, name), getattr(each.observed, name), strict=True)
            for k, (e, m) in enumerate(pairs):
                key, c = (name, k), PRIORS[name]
                if key in counted:
                    a = 0.6 / (1 + n / 10) ** 0.75 / max(1.0, active)
                    g = max(log((e + c / n) / (m + c / n)), -2.0)
                    momenta[key] = 0.7 * momenta.get(key, 0.0) + 0.3 * a * g
                    step[name].append(momenta[key])
                else:
                    g = each.window_fill * (e - m)
                    squares[key] = squares.get(key, 0.0) + g**2
                    momenta[key] = 0.8 * momenta.get(key, 0.0) + 0.2 * g
                    step[name].append(momenta[key] / sqrt((squares[key] + 1e-12) * (1 + n / 4)))
        steps.append(step)
    return steps


@pytest.mark.parametrize("counts", [COUNTS, SIGNED, MIXED, Counts(True, False), OF_SOME])
@pytest.mark.parametrize("window_fill", [1.0, 0.4])
@pytest.mark.parametrize("make", [some_counts, dense_counts])
def test_steps_are_those_of_the_formulas(counts: Counts, window_fill: float, make: Callable[[int], Parameters]) -> None:
    estimates = some_estimates(counts, window_fill=window_fill, make=make)
    for step, expected in zip(steps_of(estimates), literal_steps(estimates), strict=True):
        np.testing.assert_allclose(step.theta, expected["theta"], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(step.omega, expected["omega"], rtol=1e-12, atol=1e-14)


@every_kind
def test_what_is_expected_too_often_loses_weight_and_what_is_expected_too_seldom_gains(counts: Counts) -> None:
    """A step is taken off theta and omega."""
    expected = Parameters(np.array([2.0, 0.0, 1.0]), np.array([3.0, 0.0, 0.5]))
    shown = Parameters(np.array([1.0, 1.0, 1.0]), np.array([0.0, 2.0, 0.5]))
    (step,) = steps_of([estimate(expected, shown, counts)])
    for part in step:
        assert part[0] > 0 > part[1]
        assert part[2] == 0


@every_kind
def test_exchanging_both_sides_turns_the_step_around(counts: Counts) -> None:
    """Between sides of as many active features, on which the size of a step hangs, and that differ by less than e^2."""
    first, second = (Parameters(np.array(theta), np.array(omega)) for theta, omega in (([1, 3.0], [2.0, 1]),) * 2)
    second = Parameters(first.theta[::-1], first.omega[::-1])
    (there,), (back,) = steps_of([estimate(first, second, counts)]), steps_of([estimate(second, first, counts)])
    np.testing.assert_allclose(there.theta, -back.theta, rtol=1e-14)
    np.testing.assert_allclose(there.omega, -back.omega, rtol=1e-14)


def test_what_is_never_done_is_called_back_no_more_than_what_is_done_a_seventh_as_often() -> None:
    shown, done = (Parameters(np.array([1.0, 1.0]), np.array([1.0, 1.0])) for _ in range(2))
    done = Parameters(np.array([0.0, 1 / 9]), np.array([0.0, 1 / 8]))
    (step,) = steps_of([estimate(done, shown)])
    assert step.omega[0] == step.omega[1] == step.theta[0] < 0
    assert step.theta[0] < step.theta[1] < 0


def test_twice_as_many_visits_as_shown_are_answered_alike_in_busy_and_in_lonely_cells() -> None:
    shown = np.array([100.0, 10.0, 1000.0])
    both = Parameters(shown, shown)
    (step,) = steps_of([estimate(Parameters(2 * shown, 2 * shown), both)])
    np.testing.assert_allclose(step.theta, step.theta[0], rtol=0.01)
    np.testing.assert_allclose(step.omega, step.theta[0], rtol=0.01)


def doubled(values: Vector) -> Vector:
    return np.concatenate([values, values])


def test_a_feature_given_twice_moves_rewards_as_if_it_were_given_once() -> None:
    """Twice the features are active, so that each goes half as far: the rewards they add up to are the same."""
    once = some_estimates(COUNTS, make=dense_counts)
    twice = [
        estimate(*(Parameters(doubled(side.theta), doubled(side.omega)) for side in (each.imagined, each.observed)))
        for each in once
    ]
    for step, copies in zip(steps_of(once), steps_of(twice), strict=True):
        np.testing.assert_allclose(copies.theta, doubled(step.theta) / 2, rtol=1e-12)
        np.testing.assert_allclose(copies.omega, doubled(step.omega) / 2, rtol=1e-12)


def test_features_in_another_unit_move_rewards_as_far() -> None:
    """1000 times the features: a thousandth of the weights, but for the prior, which is small beside such counts."""
    seen, expected = (Parameters(side.theta + 100, side.omega + 100) for side in (some_counts(0), some_counts(1)))
    (step,), (fine,) = (
        steps_of([estimate(*(Parameters(unit * side.theta, unit * side.omega) for side in (expected, seen)))])
        for unit in (1.0, 1000.0)
    )
    np.testing.assert_allclose(1000 * fine.theta, step.theta, rtol=2e-3, atol=1e-8)
    np.testing.assert_allclose(1000 * fine.omega, step.omega, rtol=2e-3, atol=1e-8)


def test_where_demonstrations_show_no_feature_at_all_steps_stay_small() -> None:
    """Omega may weigh nothing but what is forbidden, and theta may be a network's or empty."""
    expected, nothing = Parameters(np.ones(2), np.array([0.3, 0.0])), Parameters(np.ones(2), np.zeros(2))
    for step in steps_of([estimate(expected, nothing, MIXED)] * 10):
        assert 0 < step.omega[0] < 5
        assert step.omega[1] == 0


def test_an_omega_that_is_never_shown_soon_costs_more_than_such_a_theta() -> None:
    never, expected = (
        Parameters(np.array([0.0, 5.0]), np.array([0.0])),
        Parameters(np.array([0.1, 5.0]), np.full(1, 0.1)),
    )
    (step,) = steps_of([estimate(expected, never)])
    assert step.omega[0] > 5 * step.theta[0] > 0


def test_rounding_below_zero_counts_as_nothing() -> None:
    """Expectations are sums of products and may end some 1e-17 below 0, where a logarithm has no value."""
    below, nothing = (Parameters(np.array([value, 1.0]), np.array([value])) for value in (-1e-3, 0.0))
    shown = Parameters(np.array([0.5, 1.0]), np.array([0.0]))
    (step,), (expected,) = steps_of([estimate(below, shown)]), steps_of([estimate(nothing, shown)])
    np.testing.assert_array_equal(step.theta, expected.theta)
    np.testing.assert_array_equal(step.omega, expected.omega)


@every_kind
def test_a_coordinate_at_rest_stays_at_rest(counts: Counts) -> None:
    nothing = Parameters(np.zeros(3), np.zeros(2))
    for step in steps_of([estimate(nothing, nothing, counts)] * 5):
        assert not step.theta.any()
        assert not step.omega.any()


@pytest.mark.parametrize(("counts", "power"), [(COUNTS, 0.75), (SIGNED, 1.0)])
def test_steps_along_one_and_the_same_estimate_vanish_and_their_sum_does_not_converge(
    counts: Counts, power: float
) -> None:
    """As Theorem 1 asks: they fall as n^-power."""
    steps = steps_of([estimate(Parameters(np.array([2.0]), np.array([3.0])), some_ones(), counts)] * 4000)
    for part in ("theta", "omega"):
        sizes = np.array([float(getattr(step, part)[0]) for step in steps])
        assert (sizes > 0).all()
        assert (np.diff(sizes[20:]) < 0).all()
        assert sizes[3999] / sizes[1999] == pytest.approx(2**-power, rel=0.01)


def some_ones() -> Parameters:
    return Parameters(np.ones(1), np.ones(1))


def test_an_adagrad_step_has_no_scale() -> None:
    gradients = some_estimates(SIGNED)
    larger = [
        estimate(*(Parameters(1e4 * side.theta, 1e4 * side.omega) for side in (each.imagined, each.observed)), SIGNED)
        for each in gradients
    ]
    for step, other in zip(steps_of(gradients), steps_of(larger), strict=True):
        np.testing.assert_allclose(step.theta, other.theta, rtol=1e-6)
        np.testing.assert_allclose(step.omega, other.omega, rtol=1e-6)


@every_kind
def test_the_state_is_four_arrays_and_decides_the_steps_to_come(counts: Counts) -> None:
    estimates, like = some_estimates(counts), some_counts(0)
    state: RuleState = RULE.initial(like)
    assert sorted(state) == ["momentum.omega", "momentum.theta", "squares.omega", "squares.theta"]
    assert not any(values.any() for values in state.values())
    for n, each in enumerate(estimates, start=1):
        before = {name: values.copy() for name, values in state.items()}
        step, after = RULE.step(state, each, n)
        again, _ = RULE.step(before, each, n)
        assert step.theta.tobytes() == again.theta.tobytes()
        assert step.omega.tobytes() == again.omega.tobytes()
        assert {name: values.tobytes() for name, values in state.items()} == {
            name: values.tobytes() for name, values in before.items()
        }
        assert {name: values.shape for name, values in after.items()} == {
            name: getattr(like, name.split(".")[1]).shape for name in state
        }
        state = after


def test_the_iteration_decides_the_step_and_not_how_many_were_made() -> None:
    each, state = some_estimates(COUNTS, 1)[0], RULE.initial(some_counts(0))
    third, _ = RULE.step(state, each, 3)
    first, _ = RULE.step(state, each, 1)
    assert (np.abs(first.omega) != np.abs(third.omega)).any()


def test_it_is_the_default_and_takes_no_numbers() -> None:
    assert AlgorithmSettings().steps == RULE
    assert experiment({"algorithm.steps": {"kind": "adaptive"}}).algorithm.steps == RULE
    with pytest.raises(ValidationError, match="alpha"):
        experiment({"algorithm.steps": {"kind": "adaptive", "alpha": 3.0}})


def test_of_some_coordinates_counts_are_compared_and_of_the_others_gradients() -> None:
    """A mask of omega: its coordinates step as they do where all are counts, or none, at the rate of those that are."""
    mask, n = np.array([True, False, True, False]), 12
    counted = [each._replace(counts=Counts(theta=True, omega=mask)) for each in some_estimates(COUNTS, n)]
    kept = [
        each._replace(observed=each.observed._replace(omega=np.where(mask, each.observed.omega, 0.0)))
        for each in counted
    ]
    of_counts = steps_of([each._replace(counts=COUNTS) for each in kept])
    of_gradients = steps_of([each._replace(counts=Counts(theta=True, omega=False)) for each in counted])
    for found, ratios, others in zip(steps_of(counted), of_counts, of_gradients, strict=True):
        np.testing.assert_array_equal(found.omega[mask], ratios.omega[mask])
        np.testing.assert_array_equal(found.omega[~mask], others.omega[~mask])
        np.testing.assert_array_equal(found.theta, ratios.theta)
