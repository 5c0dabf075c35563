"""A learner that mixes by push-sum, one call at a time: what it gives, when it gives nothing, and how it enters."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from experiments import demonstrations, experiment

from mabirds_core.arrays import Vector
from mabirds_core.assembly import build_resilient_learner
from mabirds_core.parameters import Parameters
from mabirds_core.push_sum import RunningSum, opening
from mabirds_core.resilient import ResilientLearner, ResilientState, taken

SMALLEST = 0.25
NAMES = ["ann", "bob", "cid", "dee"]
SLOTS = [
    [["ann", "bob"], ["bob", "ann"]],
    [["ann", "cid"], ["cid", "dee"], ["dee", "ann"], ["bob", "ann"], ["ann", "bob"]],
]
"""ann gives to bob; then to bob and cid, and takes from bob and dee."""

SETTINGS = experiment(
    {"learners": NAMES, "schedule": {"kind": "slots", "slots": SLOTS}, "mixing": {"kind": "resilient"}}
)


def ann() -> ResilientLearner:
    return replace(build_resilient_learner(SETTINGS, "ann"), smallest_weight=SMALLEST)


def begun(weight: float = 1.0, iteration: int = 1) -> ResilientState:
    """ann before that iteration, with parameters of her own."""
    initial = ann().learner.initial_state()
    theta, omega = (np.linspace(1, 2, values.size) for values in initial.parameters)
    return ann().begin(initial._replace(iteration=iteration, parameters=Parameters(theta, omega)), weight)


def mass(state: ResilientState, weight: float) -> Vector:
    """Of that weight, with the estimate of the state."""
    return weight * np.concatenate([*state.parameters, [1.0]])


def sum_of(values: Vector) -> RunningSum:
    return RunningSum.zero(values.size).plus(values)


@pytest.mark.parametrize(
    ("iteration", "shares", "kept"),
    [(1, {"bob": 1 / 2}, 1 / 2), (2, {"bob": 1 / 3, "cid": 1 / 3}, 1 / 3), (3, {"bob": 1 / 2}, 1 / 2)],
)
def test_a_learner_gives_its_out_neighbours_of_the_iteration_their_shares(
    iteration: int, shares: dict[str, float], kept: float
) -> None:
    state = begun(iteration=iteration)
    weights, index = ann().schedule.weights(iteration), NAMES.index
    assert shares == pytest.approx({name: weights[index(name), 0] for name in shares})
    assert {name: given.total[-1] for name, given in state.ledger.given.items()} == pytest.approx(shares)
    assert list(state.ledger.given) == list(shares)
    np.testing.assert_allclose(state.ledger.own, mass(state, kept))
    for name, share in shares.items():
        np.testing.assert_allclose(state.ledger.given[name].total, mass(state, share))


def test_shares_are_given_in_the_order_of_the_learners() -> None:
    everybody = build_resilient_learner(experiment({"learners": NAMES, "mixing": {"kind": "resilient"}}), "ann")
    assert list(everybody.begin(begun().learner).ledger.given) == ["bob", "cid", "dee"]


def test_a_learner_enters_with_weight_one() -> None:
    whole = ann().begin(begun().learner)
    assert whole.ledger.weight == 1 / 2
    assert whole.ledger.own.tobytes() == begun(weight=1.0).ledger.own.tobytes()
    assert opening(whole.parameters).own.tobytes() == mass(whole, 1.0).tobytes()


@pytest.mark.parametrize(("weight", "gives"), [(0.0, False), (np.nextafter(SMALLEST, 0), False), (SMALLEST, True)])
def test_who_has_too_little_gives_nothing(weight: float, gives: bool) -> None:
    state = begun(weight)
    assert list(state.ledger.given) == (["bob"] if gives else [])
    assert state.ledger.weight == (weight / 2 if gives else weight)
    assert (state.iteration, state.parameters.theta[0]) == (1, 1.0)


@pytest.mark.parametrize("enough", [True, False])
def test_a_newcomer_begins_once_it_was_given_enough(enough: bool) -> None:
    state, last = begun(0.0), SMALLEST - 1 / 8
    shares = {"dee": mass(state, 1 / 8) * 3, "bob": mass(state, last if enough else last - 2**-40)}
    shares["dee"][-1] = 1 / 8
    joined = ann().joined(state, 2, {name: sum_of(share) for name, share in shares.items()})
    assert (joined is not None) == enough
    if joined is not None:
        assert joined.iteration == 2
        np.testing.assert_allclose(joined.parameters.theta, 2 * state.parameters.theta)
        np.testing.assert_allclose(joined.parameters.omega, 2 * state.parameters.omega)
        assert {name: given.total[-1] for name, given in joined.ledger.given.items()} == pytest.approx(
            {"bob": SMALLEST / 3, "cid": SMALLEST / 3}
        )
        assert joined.ledger.taken.keys() == {"bob", "dee"}


@pytest.mark.parametrize(("weight", "moves"), [(np.nextafter(SMALLEST, 0), False), (SMALLEST, True)])
def test_an_estimate_moves_only_while_there_is_weight_to_carry_it(weight: float, moves: bool) -> None:
    learner, state = ann(), begun(np.nextafter(SMALLEST, 0))
    zeta = demonstrations(SETTINGS)["ann"][0]
    nothing = 0.0 * state.ledger.own
    nothing[-1] = weight - state.ledger.weight
    update = learner.update(state, zeta, {"bob": sum_of(nothing)})
    step = learner.learner.steps.descend(Parameters(*(0 * one for one in update.gradient)), update.gradient, 1)
    moved = (state.ledger.own[:-1] + np.concatenate(step)) / weight
    found = np.concatenate(update.state.parameters)
    np.testing.assert_allclose(found, moved if moves else np.concatenate(state.parameters), rtol=1e-12, atol=1e-15)
    assert np.abs(update.gradient.theta).max() > 0
    assert update.state.iteration == 2
    assert update.state.learner.recent == state.learner.recent
    assert (update.state.ledger.given.keys() == {"bob", "cid"}) == moves


@pytest.mark.parametrize("weight", [1 / 8, 1])
def test_a_closing_round_only_takes_and_gives(weight: float) -> None:
    state = begun(1 / 8)
    share = mass(state, weight - 1 / 8)
    after = ann().agree(state, {"bob": sum_of(3 * share), "dee": sum_of(-2 * share)})
    assert (after.iteration, after.learner.policy, after.learner.recent) == (2, None, ())
    np.testing.assert_allclose(after.parameters.theta, state.parameters.theta)
    given = sum(one.total for one in after.ledger.given.values())
    np.testing.assert_allclose(after.ledger.own + given, mass(state, weight), rtol=1e-12, atol=1e-12)


def test_what_arrived_is_added_in_the_order_of_names() -> None:
    """Sums of floating-point numbers depend on their order; the order of arrival must not be seen."""
    ledger = opening(Parameters(np.zeros(1), np.zeros(0)), weight=0.0)
    sums = {name: sum_of(np.array([value, 0.0])) for name, value in [("a", 1.0), ("b", 1e16), ("c", -1e16), ("d", 3.0)]}
    for order in permutations(sums):
        found = taken(ledger, {name: sums[name] for name in order})
        assert found.own[0] == ((1.0 + 1e16) - 1e16) + 3.0
        assert found.taken == sums
