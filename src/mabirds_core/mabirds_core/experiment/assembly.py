"""From an experiment's settings to the objects that learn: the one place that knows every kind by name."""

from collections.abc import Callable

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.baselines.bics import Bics
from mabirds_core.baselines.dlm import Dlm
from mabirds_core.baselines.ftl import Ftl
from mabirds_core.baselines.interface import CentralMethod
from mabirds_core.baselines.me_greedy import MeGreedy
from mabirds_core.consensus.resilient import ResilientLearner
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.settings import ResilientMixing
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.learning_settings import (
    LatticeSettings,
    NeuralRewardSettings,
    SoftActorCriticSettings,
    SoftQSettings,
)
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rewards import DroneRewardModel, LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import SampledDroneExpectation
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.interface import Expectation, Policy, PolicyFinder
from mabirds_core.planners.occupancy import ExactExpectation, SampledExpectation
from mabirds_core.planners.soft_bellman import SoftBellmanFinder
from mabirds_core.planners.soft_q_learning import SoftQFinder
from mabirds_core.rewards.models import LinearReward, NeuralReward, TabularRewardModel, TrueReward

Game = PatrolGame | DroneGame
"""Of an experiment file."""

JUDGE_SPACING = 0.3
"""Metres between the nodes on which the parameters of soft actor-critics are judged."""

AnyGame = TabularGame | DroneGame
"""That can be learned from: an enumerable one, or one of drones."""


def build_game(experiment: Experiment) -> Game:
    """The experiment's game."""
    return DroneGame(experiment.game) if isinstance(experiment.game, DroneSettings) else PatrolGame(experiment.game)


def patrol_game(experiment: Experiment) -> PatrolGame:
    """The same where only patrols will do; raises ExperimentError for others."""
    if isinstance(experiment.game, DroneSettings):
        raise ExperimentError(f"{experiment.name}: the game is drones, expected patrol; give another experiment file")
    return PatrolGame(experiment.game)


def drone_game(experiment: Experiment) -> DroneGame:
    """The same where only drones will do; raises ExperimentError for others."""
    if not isinstance(experiment.game, DroneSettings):
        raise ExperimentError(f"{experiment.name}: the game is patrol, expected drones; give another experiment file")
    return DroneGame(experiment.game)


def build_learner(experiment: Experiment, name: str, game: AnyGame | None = None) -> Learner:
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
    experiment: Experiment, name: str, game: AnyGame | None = None, schedule: EdgeSchedule | None = None
) -> ResilientLearner:
    """The same in resilient mode. ``schedule``: of the present members; default: the experiment's.

    Raises ExperimentError where the experiment's mixing is strict, or has no such learner.
    """
    if not isinstance(experiment.mixing, ResilientMixing):
        raise ExperimentError(f"mixing is {experiment.mixing.kind}, expected resilient")
    learner = build_learner(experiment, name, game)
    return ResilientLearner(learner, name, schedule or learner.schedule, experiment.mixing.smallest_weight)


METHODS = ("bics", "ftl", "dlm", "me_greedy", "me_gradient")
"""Central methods by name."""


def build_method(experiment: Experiment, name: str, game: AnyGame | None = None) -> CentralMethod:
    """Central method ``name`` with the settings of the experiment.

    Raises ExperimentError for another name, and for one that is not made for the experiment's game.
    """
    game, settings, algorithm = game or build_game(experiment), experiment.baselines, experiment.algorithm
    if name == "me_greedy":
        return _me_greedy(experiment, game)
    estimator, steps, seed = build_estimator(experiment, game, name), algorithm.steps, experiment.seed
    match name:
        case "bics":
            return Bics(estimator, steps, algorithm.window, seed)
        case "ftl":
            steps = settings.ftl.steps or steps
            return Ftl(estimator, steps, settings.ftl.tolerance, settings.ftl.most_steps, seed)
        case "dlm":
            steps = settings.dlm.steps or steps
            return Dlm(estimator, steps, settings.dlm.window, settings.dlm.tolerance, settings.dlm.most_steps, seed)
        case "me_gradient":  # BICS with nothing to learn but omega
            return Bics(estimator, settings.me_gradient.steps or steps, algorithm.window, seed)
    raise ExperimentError(f"{name!r} is none of the methods {list(METHODS)}")


def _me_greedy(experiment: Experiment, game: AnyGame) -> MeGreedy:
    if isinstance(game, DroneGame):
        raise ExperimentError("me_greedy tries constraints one by one in a tabular game; for drones, take me_gradient")
    return MeGreedy(game, experiment.baselines.me_greedy.least_mass)


def build_estimator(experiment: Experiment, game: AnyGame, method: str | None = None) -> GradientEstimator:
    """How learners of the experiment, or central ``method``, estimate the gradient."""
    expectation, start = experiment.algorithm.expectation, experiment.algorithm.rollout_start
    count = experiment.algorithm.rollouts
    if isinstance(game, DroneGame):
        model = drone_reward(experiment, game, method)
        finder = _drone_finder(experiment, game, model)
        return GradientEstimator(game, model, finder, SampledDroneExpectation(game, count), start)
    reward = tabular_reward(experiment, game, method)
    found: Expectation = ExactExpectation(game) if expectation == "exact" else SampledExpectation(game, count)
    return GradientEstimator(game, reward, _tabular_finder(experiment, game, reward), found, start)


def tabular_reward(experiment: Experiment, game: TabularGame, method: str | None = None) -> TabularRewardModel:
    """r_theta of an enumerable game, as learners or central ``method`` have it."""
    settings = experiment.algorithm.reward
    if method == "me_gradient":
        return TrueReward(game)
    if isinstance(settings, NeuralRewardSettings):
        return NeuralReward(game.reward_features, settings.hidden, settings.bound, game.n_experts)
    return LinearReward(game.reward_features)


def drone_reward(experiment: Experiment, game: DroneGame, method: str | None = None) -> DroneRewardModel:
    """The same of the drones' game."""
    settings = experiment.algorithm.reward
    if method == "me_gradient":
        return TrueDroneReward(game)
    if isinstance(settings, NeuralRewardSettings):
        return NeuralDroneReward(game, settings.hidden, settings.bound)
    return LinearDroneReward(game)


def policy_of(experiment: Experiment, name: str, game: AnyGame) -> Callable[[Parameters], Policy]:
    """What the theta and omega of a learner or method mean, whichever way it finds policies itself.

    Exactly in an enumerable game, and near-exactly, on a lattice, for one or two drones that are single integrators.
    For others a soft actor-critic begins anew, and learns as long as it does first.
    """
    if name == "me_greedy":
        return _me_greedy(experiment, game).policy
    if isinstance(game, DroneGame):
        finder: PolicyFinder = _judge(experiment, game, drone_reward(experiment, game, name))
    else:
        finder = SoftBellmanFinder(game, tabular_reward(experiment, game, name), game.cost_features)
    return lambda parameters: finder.find(*parameters, rng=np.random.default_rng(experiment.seed))


def _tabular_finder(experiment: Experiment, game: TabularGame, reward: TabularRewardModel) -> PolicyFinder:
    settings = experiment.algorithm.policy
    if isinstance(settings, SoftQSettings):
        return SoftQFinder(game, reward, game.cost_features, **settings.model_dump(exclude={"kind"}))
    return SoftBellmanFinder(game, reward, game.cost_features)


def _drone_finder(experiment: Experiment, game: DroneGame, reward: DroneRewardModel) -> PolicyFinder:
    settings = experiment.algorithm.policy
    if isinstance(settings, LatticeSettings):
        return _lattice_finder(game, reward, settings.spacing, settings.temperature)
    from mabirds_core.games.drones.soft_actor_critic import SacFinder  # torch takes a second to load, and 200 MB

    return SacFinder(game, reward, **settings.model_dump(exclude={"kind"}))


def _judge(experiment: Experiment, game: DroneGame, reward: DroneRewardModel) -> PolicyFinder:
    settings = experiment.algorithm.policy
    small = game.n_experts <= 2 and game.settings.dynamics == "single_integrator"
    if isinstance(settings, SoftActorCriticSettings) and small:
        return _lattice_finder(game, reward, JUDGE_SPACING, settings.temperature)
    return _drone_finder(experiment, game, reward)


def _lattice_finder(game: DroneGame, reward: DroneRewardModel, spacing: float, temperature: float) -> PolicyFinder:
    from mabirds_core.games.drones.lattice import LatticeFinder  # scipy is for drones: patrols do without

    return LatticeFinder(game, reward, spacing, temperature)
