"""From an experiment's settings to the objects that learn: the one place that knows every kind by name."""

from mabirds_core.algorithm import Learner
from mabirds_core.experiment import AlgorithmSettings, Experiment
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.patrol import PatrolGame
from mabirds_core.policies.interface import Expectation
from mabirds_core.policies.occupancy import ExactExpectation, SampledExpectation
from mabirds_core.policies.soft_bellman import SoftBellmanFinder
from mabirds_core.rewards import LinearReward


def build_game(experiment: Experiment) -> PatrolGame:
    """The experiment's game."""
    return PatrolGame(experiment.game)


def build_learner(experiment: Experiment, name: str, game: TabularGame | None = None) -> Learner:
    """Learner ``name`` of the experiment; ``game`` saves building the same game again.

    Raises ExperimentError where the experiment has no such learner.
    """
    game = game or build_game(experiment)
    reward = LinearReward(game.reward_features)
    return Learner(
        index=experiment.index_of(name),
        game=game,
        reward=reward,
        finder=SoftBellmanFinder(game, reward, game.cost_features),
        expectation=_expectation(experiment.algorithm, game),
        schedule=experiment.edge_schedule,
        steps=experiment.algorithm.steps,
        window=experiment.algorithm.window,
        seed=experiment.seed,
    )


def _expectation(settings: AlgorithmSettings, game: TabularGame) -> Expectation:
    if settings.expectation == "exact":
        return ExactExpectation(game)
    return SampledExpectation(game, settings.rollouts)
