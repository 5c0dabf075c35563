"""What only those can say who know what experts really may not do: refused by name where nobody knows."""

from typing import Any

from mabirds_core.arrays import Mask
from mabirds_core.errors import UnknownTruthError
from mabirds_core.games.interface import ConstrainedMarkovGame
from mabirds_core.games.judging import ImitationMetrics, Judge


def known_constraints(game: ConstrainedMarkovGame) -> Mask:
    """The true constraints, for what cannot be said without them.

    Parameters
    ----------
    game : ConstrainedMarkovGame
        Whose truth is asked for.

    Returns
    -------
    Mask
        Shape (K,).

    Raises
    ------
    UnknownTruthError
        Nobody knows them.
    """
    if game.true_constraints is None:
        raise UnknownTruthError(
            "the game's true constraints are unknown; compare methods on a game where they are known"
        )
    return game.true_constraints


def known_rates(judge: Judge, policy: Any, seed: int, rollouts: int | None = None) -> ImitationMetrics:
    """CVR and SR, for what cannot be said without them.

    Parameters
    ----------
    judge : Judge
        Of the game.
    policy : Any
        Of the game.
    seed : int
        Of rollouts, where the judge takes some.
    rollouts : int, optional
        How many it takes then.

    Returns
    -------
    ImitationMetrics
        As the judge finds them.

    Raises
    ------
    UnknownTruthError
        Nobody knows the true constraints.
    """
    rates = judge.imitation(policy, seed, rollouts)
    if rates is None:
        raise UnknownTruthError("rates need the game's true constraints, which are unknown; take a game that has them")
    return rates
