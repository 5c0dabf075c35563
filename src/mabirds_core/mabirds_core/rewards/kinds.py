"""The entry points of the reward models that every game has."""

from mabirds_core.games.whole_game import Game
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import RewardModel
from mabirds_core.rewards.settings import LinearRewardSettings, NeuralRewardSettings


def build_linear(settings: LinearRewardSettings, game: Game) -> RewardModel:  # noqa: ARG001 - there is nothing to set
    """Build theta^T f of the game's reward features.

    Parameters
    ----------
    settings : LinearRewardSettings
        There is nothing to set.
    game : Game
        With the features.

    Returns
    -------
    RewardModel
        r_theta.
    """
    model: RewardModel = game.linear_reward()
    return model


def build_neural(settings: NeuralRewardSettings, game: Game) -> RewardModel:
    """Build a network of the game.

    Parameters
    ----------
    settings : NeuralRewardSettings
        Of the network.
    game : Game
        With what it takes in.

    Returns
    -------
    RewardModel
        r_theta.
    """
    model: RewardModel = game.neural_reward(settings.hidden, settings.bound)
    return model


LINEAR = Kind(LinearRewardSettings, build_linear)
NEURAL = Kind(NeuralRewardSettings, build_neural)
