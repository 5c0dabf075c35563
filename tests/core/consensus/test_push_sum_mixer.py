"""A mixer by push-sum, one call at a time: what it sends, when it sends nothing, and how its learner enters."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from experiments import demonstrations, experiment
from pydantic import ValidationError

from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.consensus.push_sum import PushSumState, RunningSum
from mabirds_core.consensus.push_sum_mixer import PushSumMixer, ResilientMixing
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.errors import CheckpointError
from mabirds_core.experiment.assembly import build_learner

MIN_WEIGHT = 0.25
NAMES = ["ann", "bob", "cid", "dee"]
SLOTS = [
    [["ann", "bob"], ["bob", "ann"]],
    [["ann", "cid"], ["cid", "dee"], ["dee", "ann"], ["bob", "ann"], ["ann", "bob"]],
]
"""ann sends to bob; then to bob and cid, and receives from bob and dee."""

SETTINGS = experiment(
    {"learners": NAMES, "schedule": {"kind": "slots", "slots": SLOTS}, "mixing": {"kind": "resilient"}}
)
MIXER = PushSumMixer("ann", SETTINGS.edge_schedule, MIN_WEIGHT)


def ann() -> Learner:
    return replace(build_learner(SETTINGS, "ann"), mixer=MIXER)


def parameters() -> Parameters:
    """ann's own, and none of them 0."""
    return Parameters(*(np.linspace(1, 2, values.size) for values in ann().initial_state().parameters))


def begun(weight: float = 1.0, iteration: int = 1) -> PushSumState:
    """ann before that iteration, with parameters of her own."""
    return MIXER.initial(parameters(), weight, iteration)


def mass(state: PushSumState, weight: float) -> Vector:
    """Of that weight, with the estimate of the state."""
    return weight * np.concatenate([*state.parameters, [1.0]])


def sum_of(values: Vector) -> RunningSum:
    return RunningSum.zero(values.size).plus(values)


@pytest.mark.parametrize(
    ("iteration", "shares", "kept"),
    [(1, {"bob": 1 / 2}, 1 / 2), (2, {"bob": 1 / 3, "cid": 1 / 3}, 1 / 3), (3, {"bob": 1 / 2}, 1 / 2)],
)
def test_out_neighbours_of_the_iteration_are_sent_their_shares(
    iteration: int, shares: dict[str, float], kept: float
) -> None:
    state = begun(iteration=iteration)
    weights, index = MIXER.schedule.weights(iteration), NAMES.index
    assert shares == pytest.approx({name: weights[index(name), 0] for name in shares})
    assert {name: sent.total[-1] for name, sent in state.sent.items()} == pytest.approx(shares)
    assert list(state.sent) == list(MIXER.outgoing(state, iteration)) == list(shares)
    np.testing.assert_allclose(state.mass, mass(state, kept))
    for name, share in shares.items():
        np.testing.assert_allclose(state.sent[name].total, mass(state, share))


def test_shares_are_sent_in_the_order_of_the_learners() -> None:
    everybody = build_learner(experiment({"learners": NAMES, "mixing": {"kind": "resilient"}}), "ann")
    assert list(everybody.mixer.initial(parameters()).sent) == ["bob", "cid", "dee"]


def test_a_learner_enters_with_weight_one() -> None:
    whole = MIXER.initial(parameters())
    assert whole.weight == 1 / 2
    assert whole.mass.tobytes() == begun(weight=1.0).mass.tobytes()
    assert PushSumState.init(whole.parameters).mass.tobytes() == mass(whole, 1.0).tobytes()


@pytest.mark.parametrize(("weight", "sends"), [(0.0, False), (np.nextafter(MIN_WEIGHT, 0), False), (MIN_WEIGHT, True)])
def test_who_has_too_little_sends_nothing(weight: float, sends: bool) -> None:
    state = begun(weight)
    assert list(state.sent) == list(MIXER.outgoing(state, 1)) == (["bob"] if sends else [])
    assert state.weight == (weight / 2 if sends else weight)
    assert state.parameters.theta.tobytes() == parameters().theta.tobytes()


@pytest.mark.parametrize("enough", [True, False])
def test_a_late_joiner_begins_once_it_was_sent_enough(enough: bool) -> None:
    state, last = begun(0.0), MIN_WEIGHT - 1 / 8
    shares = {"dee": mass(state, 1 / 8) * 3, "bob": mass(state, last if enough else last - 2**-40)}
    shares["dee"][-1] = 1 / 8
    joined = MIXER.join(state, 2, {name: sum_of(share) for name, share in shares.items()})
    assert (joined is not None) == enough
    if joined is not None:
        np.testing.assert_allclose(joined.parameters.theta, 2 * state.parameters.theta)
        np.testing.assert_allclose(joined.parameters.omega, 2 * state.parameters.omega)
        assert {name: sent.total[-1] for name, sent in joined.sent.items()} == pytest.approx(
            {"bob": MIN_WEIGHT / 3, "cid": MIN_WEIGHT / 3}
        )
        assert joined.received.keys() == {"bob", "dee"}


@pytest.mark.parametrize(("weight", "moves"), [(np.nextafter(MIN_WEIGHT, 0), False), (MIN_WEIGHT, True)])
def test_an_estimate_moves_only_while_there_is_weight_to_carry_it(weight: float, moves: bool) -> None:
    learner, state = ann(), begun(np.nextafter(MIN_WEIGHT, 0))
    zeta = demonstrations(SETTINGS)["ann"][0]
    nothing = 0.0 * state.mass
    nothing[-1] = weight - state.weight
    before = learner.initial_state()._replace(mixing=state)
    after, estimate = learner.step(before, zeta, {"bob": sum_of(nothing)})
    step, _ = learner.steps.step(before.rule, estimate, 1)
    moved = (state.mass[:-1] - np.concatenate(step)) / weight
    found = np.concatenate(after.parameters)
    np.testing.assert_allclose(found, moved if moves else np.concatenate(state.parameters), rtol=1e-12, atol=1e-15)
    assert np.abs(estimate.gradient.theta).max() > 0
    assert after.iteration == 2
    assert isinstance(after.mixing, PushSumState)
    assert (after.mixing.sent.keys() == {"bob", "cid"}) == moves


@pytest.mark.parametrize("weight", [1 / 8, 1])
def test_a_closing_round_only_receives_and_sends(weight: float) -> None:
    state = begun(1 / 8)
    share = mass(state, weight - 1 / 8)
    incoming = {"bob": sum_of(3 * share), "dee": sum_of(-2 * share)}
    before = ann().initial_state()._replace(mixing=state)
    after = ann().consensus_step(before, incoming)
    assert (after.iteration, after.policy, after.memory, after.rule) == (2, None, before.memory, before.rule)
    np.testing.assert_allclose(after.parameters.theta, state.parameters.theta)
    assert isinstance(after.mixing, PushSumState)
    sent = sum(total.total for total in after.mixing.sent.values())
    np.testing.assert_allclose(after.mixing.mass + sent, mass(state, weight), rtol=1e-12, atol=1e-12)


def test_what_arrived_is_added_in_the_order_of_names() -> None:
    """Sums of floating-point numbers depend on their order; the order of arrival must not be seen."""
    state = PushSumState.init(Parameters(np.zeros(1), np.zeros(0)), initial_weight=0.0)
    sums = {name: sum_of(np.array([value, 0.0])) for name, value in [("a", 1.0), ("b", 1e16), ("c", -1e16), ("d", 3.0)]}
    for order in permutations(sums):
        found = MIXER.incoming(state, 1, {name: sums[name] for name in order})
        assert found.mass[0] == ((1.0 + 1e16) - 1e16) + 3.0
        assert found.received == sums


def test_after_a_step_the_shares_of_the_next_iteration_are_sent() -> None:
    """Pairs with b, c and d in turn: what leaves after iteration n is for the neighbour of n + 1."""
    slots = tuple(both_ways([(0, other)]) for other in (1, 2, 3))
    mixer = PushSumMixer("a", EdgeSchedule(tuple("abcd"), slots), MIN_WEIGHT)
    state = mixer.initial(parameters())
    assert list(state.sent) == ["b"]
    for n, neighbours in ((1, ["b", "c"]), (2, ["b", "c", "d"])):
        state = mixer.mix(state, n, None)
        assert list(state.sent) == neighbours


def test_after_the_end_of_a_schedule_that_stops_nothing_is_sent() -> None:
    mixer = PushSumMixer("a", EdgeSchedule(("a", "b"), (both_ways([(0, 1)]),), end="stop"), MIN_WEIGHT)
    state = mixer.initial(parameters())
    after = mixer.mix(state, 1, None)
    assert after.sent == state.sent
    assert after.weight == 1 / 2


STATE = PushSumState(
    np.array([1.0, 2.0, 3.0, 0.5]),
    {"bob": RunningSum(np.array([4.0, 5.0, 6.0, 7.0]), np.array([0.1, 0.2, 0.3, 0.4]))},
    {"dee": RunningSum(np.array([8.0, 9.0, 10.0, 11.0]), np.zeros(4)), "cid": RunningSum.zero(4)},
    Parameters(np.array([2.0, 4.0]), np.array([6.0])),
)
"""Two numbers of theta, one of omega, and the weight."""


def test_a_checkpoint_holds_the_masses_by_the_names_that_earlier_versions_wrote() -> None:
    arrays = MIXER.to_arrays(STATE)
    assert {name: values.tolist() for name, values in arrays.items()} == {
        "mass": [1.0, 2.0, 3.0, 0.5],
        "mass.given.bob": [[4.0, 5.0, 6.0, 7.0], [0.1, 0.2, 0.3, 0.4]],
        "mass.taken.dee": [[8.0, 9.0, 10.0, 11.0], [0.0, 0.0, 0.0, 0.0]],
        "mass.taken.cid": [[0.0] * 4, [0.0] * 4],
    }


def test_the_state_comes_back_from_a_checkpoint_that_holds_other_arrays_as_well() -> None:
    others = {"theta": np.zeros(2), "omega": np.zeros(1), "epoch": np.full(3, np.nan), "masses": np.zeros(9)}
    again = MIXER.from_arrays(STATE.parameters, {**others, **MIXER.to_arrays(STATE)})
    assert again.mass.tolist() == STATE.mass.tolist()
    assert again.parameters == STATE.parameters
    for found, expected in ((again.sent, STATE.sent), (again.received, STATE.received)):
        assert {name: np.stack(total).tolist() for name, total in found.items()} == {
            name: np.stack(total).tolist() for name, total in expected.items()
        }


def test_a_checkpoint_without_masses_gives_none() -> None:
    again = MIXER.from_arrays(STATE.parameters, {"epoch": np.zeros(3)})
    assert (again.mass.tolist(), again.sent, again.received) == ([0.0] * 4, {}, {})


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("mass", np.zeros(3)),
        ("mass", np.zeros(5)),
        ("mass", np.zeros((2, 4))),
        ("mass", np.array([1.0, np.inf, 1.0, 1.0])),
        ("mass.given.bob", np.zeros(4)),
        ("mass.given.bob", np.zeros((1, 4))),
        ("mass.given.bob", np.zeros((3, 4))),
        ("mass.given.bob", np.zeros((2, 3))),
        ("mass.taken.dee", np.full((2, 4), np.nan)),
        ("mass.taken.dee", np.zeros((4, 2))),
    ],
)
def test_masses_that_do_not_fit_the_parameters_are_refused_by_name(name: str, values: Array) -> None:
    with pytest.raises(CheckpointError, match=f"^{name}: expected finite numbers, 4 in a row"):
        MIXER.from_arrays(STATE.parameters, {**MIXER.to_arrays(STATE), name: values})


def test_its_settings_build_it_and_say_that_members_may_depart() -> None:
    settings = ResilientMixing(kind="resilient")
    assert (settings.patience, settings.smallest_weight, settings.declares_members) == (1.0, 0.1, True)
    chosen = ResilientMixing(kind="resilient", smallest_weight=0.25)
    assert chosen.mixer("bob", MIXER.schedule) == PushSumMixer("bob", MIXER.schedule, 0.25)


@pytest.mark.parametrize(
    ("name", "fitting", "refused"),
    [
        ("patience", [1e-9, 0.5, 3600.0], [0.0, -0.5, 3600.5]),
        ("smallest_weight", [1e-9, 0.5, 0.999], [0.0, -0.5, 1.0, 1.5]),
    ],
)
def test_its_settings_have_limits(name: str, fitting: list[float], refused: list[float]) -> None:
    for value in fitting:
        assert getattr(ResilientMixing.model_validate({"kind": "resilient", name: value}), name) == value
    for value in refused:
        with pytest.raises(ValidationError, match=name):
            ResilientMixing.model_validate({"kind": "resilient", name: value})
