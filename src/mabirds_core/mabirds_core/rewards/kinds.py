"""The entry points of the reward models that every game has."""

from mabirds_core.games.interface import Game
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import RewardModel
from mabirds_core.rewards.settings import LinearRewardSettings, NeuralRewardSettings


def build_linear(settings: LinearRewardSettings, game: Game) -> RewardModel:  # noqa: ARG001 - there is nothing to set
    """theta^T f of the game's reward features."""
    model: RewardModel = game.linear_reward()
    return model


def build_neural(settings: NeuralRewardSettings, game: Game) -> RewardModel:
    """A network of the game."""
    model: RewardModel = game.neural_reward(settings.hidden, settings.bound)
    return model


LINEAR = Kind(LinearRewardSettings, build_linear)
NEURAL = Kind(NeuralRewardSettings, build_neural)
