"""From an experiment's settings to the objects that learn: the one place that knows every kind by name."""

from collections.abc import Callable

from mabirds_core.algorithm import Learner
from mabirds_core.baselines.bics import Bics
from mabirds_core.baselines.dlm import Dlm
from mabirds_core.baselines.ftl import Ftl
from mabirds_core.baselines.interface import CentralMethod
from mabirds_core.baselines.me_greedy import MeGreedy
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment import AlgorithmSettings, Experiment, NeuralRewardSettings, SoftQSettings
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.patrol import PatrolGame
from mabirds_core.gradient import GradientEstimator
from mabirds_core.mixing import ResilientMixing
from mabirds_core.parameters import Parameters
from mabirds_core.policies.interface import Expectation, Policy, PolicyFinder
from mabirds_core.policies.occupancy import ExactExpectation, SampledExpectation
from mabirds_core.policies.soft_bellman import SoftBellmanFinder
from mabirds_core.policies.soft_q_learning import SoftQFinder
from mabirds_core.resilient import ResilientLearner
from mabirds_core.rewards import LinearReward, NeuralReward, RewardModel
from mabirds_core.schedule import EdgeSchedule


def build_game(experiment: Experiment) -> PatrolGame:
    """The experiment's game."""
    return PatrolGame(experiment.game)


def build_learner(experiment: Experiment, name: str, game: TabularGame | None = None) -> Learner:
    """Learner ``name`` of the experiment; ``game`` saves building the same game again.

    Raises ExperimentError where the experiment has no such learner.
    """
    return Learner(
        index=experiment.index_of(name),
        estimator=build_estimator(experiment, game or build_game(experiment)),
        schedule=experiment.edge_schedule,
        steps=experiment.algorithm.steps,
        window=experiment.algorithm.window,
        seed=experiment.seed,
    )


def build_resilient_learner(
    experiment: Experiment, name: str, game: TabularGame | None = None, schedule: EdgeSchedule | None = None
) -> ResilientLearner:
    """The same in resilient mode. ``schedule``: of the present members; default: the experiment's.

    Raises ExperimentError where the experiment's mixing is strict, or has no such learner.
    """
    if not isinstance(experiment.mixing, ResilientMixing):
        raise ExperimentError(f"mixing is {experiment.mixing.kind}, expected resilient")
    learner = build_learner(experiment, name, game)
    return ResilientLearner(learner, name, schedule or learner.schedule, experiment.mixing.smallest_weight)


METHODS = ("bics", "ftl", "dlm", "me_greedy")
"""Central methods by name."""


def build_method(experiment: Experiment, name: str, game: TabularGame | None = None) -> CentralMethod:
    """Central method ``name`` with the settings of the experiment; raises ExperimentError for another name."""
    game, settings = game or build_game(experiment), experiment.baselines
    estimator, steps, seed = build_estimator(experiment, game), experiment.algorithm.steps, experiment.seed
    match name:
        case "bics":
            return Bics(estimator, steps, experiment.algorithm.window, seed)
        case "ftl":
            steps = settings.ftl.steps or steps
            return Ftl(estimator, steps, settings.ftl.tolerance, settings.ftl.most_steps, seed)
        case "dlm":
            steps = settings.dlm.steps or steps
            return Dlm(estimator, steps, settings.dlm.window, settings.dlm.tolerance, settings.dlm.most_steps, seed)
        case "me_greedy":
            return MeGreedy(game, settings.me_greedy.least_mass)
    raise ExperimentError(f"{name!r} is none of the methods {list(METHODS)}")


def build_estimator(experiment: Experiment, game: TabularGame) -> GradientEstimator:
    """How learners and central methods of the experiment estimate the gradient."""
    settings, reward = experiment.algorithm, build_reward(experiment, game)
    finder, expectation = _finder(settings, game, reward), _expectation(settings, game)
    return GradientEstimator(game, reward, finder, expectation, settings.rollout_start)


def build_reward(experiment: Experiment, game: TabularGame) -> RewardModel:
    """r_theta."""
    settings = experiment.algorithm.reward
    if isinstance(settings, NeuralRewardSettings):
        return NeuralReward(game.reward_features, settings.hidden, settings.bound, game.n_experts)
    return LinearReward(game.reward_features)


def policy_of(experiment: Experiment, name: str, game: TabularGame) -> Callable[[Parameters], Policy]:
    """What the theta and omega of a learner or method mean, exactly, whichever way it finds policies itself."""
    if name == "me_greedy":
        return MeGreedy(game, experiment.baselines.me_greedy.least_mass).policy
    finder = SoftBellmanFinder(game, build_reward(experiment, game), game.cost_features)
    return lambda parameters: finder.find(*parameters)


def _finder(settings: AlgorithmSettings, game: TabularGame, reward: RewardModel) -> PolicyFinder:
    if isinstance(settings.policy, SoftQSettings):
        return SoftQFinder(game, reward, game.cost_features, **settings.policy.model_dump(exclude={"kind"}))
    return SoftBellmanFinder(game, reward, game.cost_features)


def _expectation(settings: AlgorithmSettings, game: TabularGame) -> Expectation:
    if settings.expectation == "exact":
        return ExactExpectation(game)
    return SampledExpectation(game, settings.rollouts)
