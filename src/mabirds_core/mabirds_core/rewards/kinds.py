"""The entry points of the reward models that every game has."""

from mabirds_core.games.whole_game import Game
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import RewardModel
from mabirds_core.rewards.settings import LinearRewardSettings, NeuralRewardSettings


def build_linear(settings: LinearRewardSettings, game: Game) -> RewardModel:
    """Build theta^T f of the game's reward features, and of coming too late where the game can say that.

    Parameters
    ----------
    settings : LinearRewardSettings
        With or without lateness.
    game : Game
        With the features.

    Returns
    -------
    RewardModel
        r_theta.
    """
    arriving = getattr(game, "arriving_reward", None) if settings.lateness else None
    model: RewardModel = (arriving or game.linear_reward)()
    return model


def build_neural(settings: NeuralRewardSettings, game: Game) -> RewardModel:
    """Build a network of the game, and a parameter of coming too late beside it where the game can say that.

    Parameters
    ----------
    settings : NeuralRewardSettings
        Of the network, with or without lateness.
    game : Game
        With what it takes in.

    Returns
    -------
    RewardModel
        r_theta.
    """
    arriving = getattr(game, "arriving_neural_reward", None) if settings.lateness else None
    model: RewardModel = (arriving or game.neural_reward)(settings.hidden, settings.bound)
    return model


LINEAR = Kind(LinearRewardSettings, build_linear)
NEURAL = Kind(NeuralRewardSettings, build_neural)
