"""Which messages are kept, to the very iteration at which each refusal begins."""

import numpy as np
import pytest

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import RefusedMessageError
from mabirds_core.games.interface import Trajectories
from mabirds_learner.inbox import Content, check_iteration

KEPT = Parameters(np.array([1.0, -0.0]), np.array([2.0]))
KNOWN = {5: KEPT, 7: KEPT}
"""Of a learner at iteration 5 that keeps three: 5, 6 and 7."""


def reason(iteration: int, content: Content = KEPT) -> str | None:
    """Why it is refused; None: it is not."""
    try:
        check_iteration(iteration, 5, KNOWN, 3, content)
    except RefusedMessageError as error:
        return error.reason
    return None


@pytest.mark.parametrize(
    ("iteration", "expected"),
    [
        (0, "old_iteration"),
        (4, "old_iteration"),
        (5, "duplicate"),
        (6, None),
        (7, "duplicate"),
        (8, "future_iteration"),
        (2**64 - 1, "future_iteration"),
    ],
)
def test_it_keeps_new_ones_of_the_next_iterations_only(iteration: int, expected: str | None) -> None:
    assert reason(iteration) == expected


@pytest.mark.parametrize(
    "other",
    [
        Parameters(KEPT.theta, np.array([3.0])),
        Parameters(np.array([1.0, 0.0]), KEPT.omega),
        Parameters(np.array([1.0]), KEPT.omega),
    ],
    ids=["one number differs", "one sign of zero differs", "one number is missing"],
)
def test_a_second_one_that_says_something_else_is_a_conflict(other: Parameters) -> None:
    assert reason(7, other) == "conflict"
    assert reason(7, Parameters(KEPT.theta.copy(), KEPT.omega.copy())) == "duplicate"


def test_an_old_one_is_old_whatever_is_known_of_it() -> None:
    with pytest.raises(RefusedMessageError, match="iteration 4, expected 5 or later") as refused:
        check_iteration(4, 5, {4: KEPT}, 3, KEPT)
    assert refused.value.reason == "old_iteration"


def test_one_too_far_ahead_is_told_where_that_begins() -> None:
    with pytest.raises(RefusedMessageError, match="iteration 8, expected less than 8$"):
        check_iteration(8, 5, KNOWN, 3, KEPT)


def test_demonstrations_are_the_same_where_states_and_actions_are() -> None:
    states, actions = np.array([[1, 2]]), np.array([[0, 3]])
    known = {1: Trajectories(states, actions)}
    for other, expected in ((Trajectories(states, actions), "duplicate"), (Trajectories(states, states), "conflict")):
        with pytest.raises(RefusedMessageError) as refused:
            check_iteration(1, 1, known, 3, other)
        assert refused.value.reason == expected
