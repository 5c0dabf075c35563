"""The strict mixer, one call at a time: whom it sends to, whom it expects, and the weighted sum by hand."""

import numpy as np
import pytest
from pydantic import ValidationError

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.consensus.strict import StrictMixer, StrictMixing, StrictState
from mabirds_core.errors import ScheduleError

NAMES = ("cid", "ann", "bob")
CYCLE = frozenset({(0, 1), (1, 2), (2, 0)})
SCHEDULE = EdgeSchedule(NAMES, (both_ways([(0, 1), (1, 2)]), CYCLE))
"""The line cid - ann - bob, weights 1/3; then the directed ring cid -> ann -> bob -> cid, weights 1/2."""

ANN = StrictMixer("ann", SCHEDULE)
OWN = Parameters(np.array([3.0, -6.0]), np.array([12.0]))
OF_BOB = Parameters(np.array([30.0, 60.0]), np.array([-90.0]))
OF_CID = Parameters(np.array([300.0, 0.0]), np.array([600.0]))


def numbers(parameters: Parameters) -> tuple[list[float], list[float]]:
    return parameters.theta.tolist(), parameters.omega.tolist()


def doubled(parameters: Parameters) -> Parameters:
    return Parameters(2 * parameters.theta, 2 * parameters.omega)


def test_it_begins_with_the_parameters_it_is_given_and_nothing_of_others() -> None:
    state = ANN.initial(OWN)
    assert state == StrictState(OWN, None)
    assert ANN.outgoing(state, 1) == {"cid": OWN, "bob": OWN}


def test_out_neighbours_of_the_iteration_are_sent_its_parameters() -> None:
    assert ANN.outgoing(StrictState(OWN, {"bob": OF_BOB}), 2) == {"bob": OWN}


@pytest.mark.parametrize(
    ("iteration", "expected", "theta", "omega"),
    [
        (1, {"bob": OF_BOB, "cid": OF_CID}, [111.0, 18.0], [174.0]),
        (2, {"cid": OF_CID}, [151.5, -3.0], [306.0]),
        (3, {"cid": OF_CID, "bob": OF_BOB}, [111.0, 18.0], [174.0]),
    ],
)
def test_what_in_neighbours_sent_is_mixed_by_the_weights_of_the_iteration(
    iteration: int, expected: dict[str, Parameters], theta: list[float], omega: list[float]
) -> None:
    state = ANN.incoming(ANN.initial(OWN), iteration, expected)
    assert (state.parameters, state.received) == (OWN, expected)
    mixed = ANN.mix(state, iteration, None)
    np.testing.assert_allclose(mixed.parameters.theta, theta, rtol=1e-15)
    np.testing.assert_allclose(mixed.parameters.omega, omega, rtol=1e-15)
    assert mixed.received is None, "what has been mixed does not enter the next iteration"


def test_where_nothing_was_received_only_its_own_part_is_summed() -> None:
    mixed = ANN.mix(ANN.initial(OWN), 1, None)
    np.testing.assert_allclose(np.concatenate(mixed.parameters), [1.0, -2.0, 4.0], rtol=1e-15)


def test_the_local_step_is_taken_from_the_weighted_sum() -> None:
    state = ANN.incoming(ANN.initial(OWN), 2, {"cid": OF_CID})
    mixed, stepped = ANN.mix(state, 2, None), ANN.mix(state, 2, doubled)
    assert numbers(stepped.parameters) == numbers(doubled(mixed.parameters))
    assert stepped.received is None


def test_the_sum_is_taken_in_the_order_of_the_list_of_learners() -> None:
    """Sums of floating-point numbers depend on their order; that of arrival must not be seen."""
    values = {"cid": 1e16, "ann": 1.0, "bob": -1e16}
    sent = {name: Parameters(np.array([value]), np.array([value])) for name, value in values.items()}
    for order in (("cid", "bob"), ("bob", "cid")):
        state = ANN.incoming(ANN.initial(sent["ann"]), 1, {name: sent[name] for name in order})
        weight = float(SCHEDULE.weights(1)[1, 0])
        mixed = ANN.mix(state, 1, None).parameters
        expected = (weight * 1e16 + float(SCHEDULE.weights(1)[1, 1])) - weight * 1e16
        assert numbers(mixed) == ([expected], [expected])


@pytest.mark.parametrize(
    ("iteration", "messages", "words"),
    [
        (1, ["cid"], r"iteration 1: parameters of learners \['cid'\], expected \['bob', 'cid'\]"),
        (2, ["cid", "bob"], r"iteration 2: parameters of learners \['bob', 'cid'\], expected \['cid'\]"),
        (2, [], r"iteration 2: parameters of learners \[\], expected \['cid'\]"),
        (2, ["bob"], r"iteration 2: parameters of learners \['bob'\], expected \['cid'\]"),
    ],
    ids=["too few", "too many", "none", "another"],
)
def test_it_mixes_with_exactly_the_in_neighbours(iteration: int, messages: list[str], words: str) -> None:
    with pytest.raises(ScheduleError, match=words):
        ANN.incoming(ANN.initial(OWN), iteration, dict.fromkeys(messages, OF_BOB))


def test_parameters_are_all_that_a_checkpoint_must_hold() -> None:
    state = StrictState(OWN, {"bob": OF_BOB})
    assert ANN.to_arrays(state) == {}
    assert ANN.from_arrays(OWN, {}) == StrictState(OWN, None)


def test_its_settings_build_it_and_say_that_nobody_is_left_out() -> None:
    settings = StrictMixing()
    assert settings.kind == "strict"
    assert settings.mixer("bob", SCHEDULE) == StrictMixer("bob", SCHEDULE)
    assert settings.declares_members is False
    with pytest.raises(ValidationError):
        StrictMixing.model_validate({"kind": "resilient"})
