"""Two of the drones of a game, as a game of their own: what planners of one or two drones need to plan for pairs."""

from dataclasses import dataclass

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.drone_nodes import Rewards
from mabirds_core.games.drones.features import DroneReward
from mabirds_core.games.drones.game import DroneGame


@dataclass(frozen=True)
class PairReward:
    """Of the whole game's reward, the terms of two of its drones; parameters are those of the whole game.

    Attributes
    ----------
    whole : DroneReward
        Of all drones.
    drones : tuple[int, int]
        Indices of the two in the whole game.
    pair : int
        Their index into its pairs.
    """

    whole: DroneReward
    drones: tuple[int, int]
    pair: int

    def unary(self, weights: Vector, drone: int, states: Array, actions: Array) -> Array:
        """Terms of the first (0) or second (1) of the two drones."""
        return self.whole.unary(weights, self.drones[drone], states, actions)

    def pairwise(self, weights: Vector, pair: int, distances: Array) -> Array:  # noqa: ARG002 - there is one
        """Terms of their distance."""
        return self.whole.pairwise(weights, self.pair, distances)


def pair_game(whole: DroneGame, pair: int) -> DroneGame:
    """The game of two drones alone.

    Its features have other weights than those of the whole game; ``rewards_of_pair`` has what these earn in it.

    Parameters
    ----------
    whole : DroneGame
        Of two drones or more.
    pair : int
        Index into its pairs.

    Returns
    -------
    DroneGame
        Of the same arena.
    """
    drones = tuple(whole.settings.drones[i] for i in whole.pairs[pair])
    # Costs of the user's own may name drones by numbers that they do not have in here.
    return DroneGame(whole.settings.model_copy(update={"drones": drones, "costs": {}}))


def rewards_of_pair(whole: DroneGame, pair: int, rewards: Rewards) -> Rewards:
    """What two drones earn in the game of theirs.

    Parameters
    ----------
    whole : DroneGame
        Of two drones or more.
    pair : int
        Index into its pairs.
    rewards : Rewards
        What r of the whole game is the sum of.

    Returns
    -------
    Rewards
        What r of ``pair_game`` is the sum of.
    """
    return tuple((PairReward(of, whole.pairs[pair], pair), weights) for of, weights in rewards)
