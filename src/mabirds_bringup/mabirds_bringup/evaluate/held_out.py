"""Demonstrations that nobody learned from, and the policy of those who gave them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from mabirds_core.algorithm.memory import stacked
from mabirds_core.errors import InfeasibleError
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.whole_game import Game

HELD_OUT = 200
"""Demonstrations that experts draw anew, on which likelihoods are taken."""

HELD_OUT_BY_SEARCH = 200
"""As many of experts who search for each of them, and have no policy: places that 50 visit are .1 off those of many."""


class HeldOut(NamedTuple):
    """What policies are compared with.

    Attributes
    ----------
    experts : Any or None
        Their policy; None where the game's judge cannot follow it.
    demonstrations : Trajectories or None
        HELD_OUT of them, or HELD_OUT_BY_SEARCH; None where there are no experts, or they find no way: the bag may be
        somebody else's.
    """

    experts: Any
    demonstrations: Trajectories | None

    def log_likelihood(self, game: Game, policy: Any) -> float | None:
        """Mean log p of the demonstrations under a policy.

        Parameters
        ----------
        game : Game
            With its judge.
        policy : Any
            Of the game.

        Returns
        -------
        float or None
            In nats per demonstration; None without a policy or demonstrations, or where the game cannot say.
        """
        if policy is None or self.demonstrations is None:
            return None
        nats = game.judge.log_likelihoods(policy, self.demonstrations)
        return None if nats is None else float(nats.mean())

    def fixed_log_likelihoods(self, game: Game, policy: Any) -> Mapping[str, float]:
        """Mean log p of the demonstrations under policies that take no learning.

        Parameters
        ----------
        game : Game
            With its judge.
        policy : Any
            A learned one of the game.

        Returns
        -------
        Mapping
            By the policy's name, in nats per demonstration; empty where the game has none.
        """
        return {} if self.demonstrations is None else game.judge.fixed_log_likelihoods(policy, self.demonstrations)


def draw_held_out(experiment: Experiment, game: Game) -> HeldOut:
    """Draw demonstrations that no recording with the experiment's seed has.

    Parameters
    ----------
    experiment : Experiment
        With its experts and seeds.
    game : Game
        Of the experiment.

    Returns
    -------
    HeldOut
        The experts' policy, and demonstrations of theirs.
    """
    drawn = experiment.demonstrations
    experts = game.experts(drawn.experts, drawn.side) if game.expert_kinds else None
    if experts is None:
        return HeldOut(None, None)
    rng = np.random.default_rng([drawn.seed, HELD_OUT, experiment.seed])
    count = HELD_OUT_BY_SEARCH if experts.policy is None else HELD_OUT
    try:
        return HeldOut(experts.policy, stacked([*experts.demonstrations(count, rng)]))
    except InfeasibleError:
        return HeldOut(experts.policy, None)
