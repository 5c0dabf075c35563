"""What the checks share: demonstrations, finite differences, and how an expectation is told."""

from collections.abc import Callable

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import Trajectories, Visitation, discounted_visitation
from mabirds_core.games.whole_game import Game

DEMONSTRATIONS = 5
"""Drawn of a game's experts."""

STEP = 1e-5
"""Step of finite differences."""


def visitations(game: Game, seed: int) -> list[Visitation]:
    """Visit what a few demonstrations do.

    Parameters
    ----------
    game : Game
        Of the demonstrations.
    seed : int
        Of the experts' choices.

    Returns
    -------
    list[Visitation]
        One each.
    """
    return [discounted_visitation(shown, game.discount) for shown in demonstrations(game, seed)]


def demonstrations(game: Game, seed: int) -> list[Trajectories]:
    """Draw a few demonstrations.

    Parameters
    ----------
    game : Game
        Whose first experts demonstrate.
    seed : int
        Of their choices.

    Returns
    -------
    list[Trajectories]
        One each; none where the game has no experts.
    """
    if not game.expert_kinds:
        return []
    experts = game.experts(game.expert_kinds[0], "by_start")
    return list(experts.demonstrations(DEMONSTRATIONS, np.random.default_rng(seed)))


def by_table(table: Callable[[Vector], Array], visitation: Visitation, theta: Vector) -> float:
    """What a visitation earns by a table.

    Parameters
    ----------
    table : Callable[[Vector], Array]
        From parameters to rewards r, shape (S, A).
    visitation : Visitation
        Weighted pairs.
    theta : Vector
        The parameters.

    Returns
    -------
    float
        sum_k weights[k] r(states[k], actions[k]).
    """
    return float(visitation.weights @ table(theta)[visitation.states, visitation.actions])


def differences_of(function: Callable[[Vector], float], at: Vector) -> Vector:
    """Differentiate a function of a vector by central differences.

    Parameters
    ----------
    function : Callable[[Vector], float]
        The function.
    at : Vector
        Where, shape (n,).

    Returns
    -------
    Vector
        Its gradient, shape (n,).
    """
    units = STEP * np.eye(len(at))
    return np.array([(function(at + unit) - function(at - unit)) / (2 * STEP) for unit in units])


def fails(call: Callable[[], object], error: type[Exception] = Exception) -> bool:
    """Tell whether a call fails.

    Parameters
    ----------
    call : Callable[[], object]
        Is made.
    error : type, optional
        Of error that counts; others are raised.

    Returns
    -------
    bool
        Does it raise the error?
    """
    try:
        call()
    except error:
        return True
    return False


def require(condition: bool, expectation: str) -> None:  # noqa: FBT001 - a condition, as of assert
    """Say what was expected where it is not so.

    Parameters
    ----------
    condition : bool
        What is to hold.
    expectation : str
        Of the error.

    Raises
    ------
    AssertionError
        It does not hold.
    """
    if not condition:
        raise AssertionError(expectation)
