"""From an experiment's settings to the objects that learn."""

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.memory import Memory, RunningMean, WindowMemory
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.learning_settings import MAX_WINDOW
from mabirds_core.games.whole_game import Game
from mabirds_core.planners.interface import Policy
from mabirds_core.registry import METHODS, build, kind_of, kinds, require
from mabirds_core.rewards.models import RewardModel, SummableReward
from mabirds_core.rewards.shown import RewardWithShown

if TYPE_CHECKING:
    from mabirds_core.baselines.interface import CentralMethod


def build_game(experiment: Experiment) -> Game:
    """The experiment's game, with what its omega means where that is more than weights of cost features."""
    game: Any = build("mabirds.games", experiment.game)
    costs = build("mabirds.costs", experiment.algorithm.cost, game)
    if not costs.linear:
        game.cost_model = costs
    return cast("Game", game)


def build_reward(experiment: Experiment, game: Game) -> RewardModel:
    """Build r_theta.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm.reward``.
    game : Game
        Of the experiment.

    Returns
    -------
    RewardModel
        r_theta.
    """
    model: RewardModel = build("mabirds.rewards", experiment.algorithm.reward, game)
    return model


def learners_reward(experiment: Experiment, game: Game) -> RewardModel:
    """Build r_theta as learners have it, whose theta may say more: what was shown to whom.

    That is so with ``algorithm.share_shown``, where the game has a constraint test, the reward is a sum of features and
    no demonstration is forgotten.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm``.
    game : Game
        Of the experiment.

    Returns
    -------
    RewardModel
        r_theta.
    """
    reward: Any = build_reward(experiment, game)
    algorithm = experiment.algorithm
    told = algorithm.share_shown and algorithm.window == "all" and hasattr(game, "neutral_change")
    if not (told and hasattr(reward, "gradient_of_total") and hasattr(reward, "weights")):
        return cast("RewardModel", reward)
    return RewardWithShown(reward, tuple(game.cost_features.names))


def build_learner(experiment: Experiment, name: str, game: Game | None = None) -> Learner:
    """Build a learner with its mixer.

    Parameters
    ----------
    experiment : Experiment
        With its settings.
    name : str
        Of the learner.
    game : Game, optional
        Of the experiment; saves building the same game again.

    Returns
    -------
    Learner
        Before the first demonstration.

    Raises
    ------
    ExperimentError
        The experiment has no such learner.
    """
    game = game or build_game(experiment)
    reward = learners_reward(experiment, game)
    return Learner(
        index=experiment.index_of(name),
        estimator=build_estimator(experiment, game, reward),
        mixer=build("mabirds.mixers", experiment.mixing, name, experiment.edge_schedule),
        steps=build("mabirds.step_rules", experiment.algorithm.steps),
        memory=build_memory(experiment, game, reward),
        seed=experiment.seed,
    )


def build_memory(experiment: Experiment, game: Game, reward: RewardModel) -> Memory:
    """Build what a learner keeps of its demonstrations.

    The mean of all needs the demonstrations themselves where a reward's gradient is more than feature counts; then the
    newest MAX_WINDOW are kept.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm.window``.
    game : Game
        Of the experiment.
    reward : RewardModel
        r_theta.

    Returns
    -------
    Memory
        Empty.
    """
    window = experiment.algorithm.window
    if window != "all":
        return WindowMemory(game, reward, window)
    if hasattr(reward, "gradient_of_total"):
        return RunningMean.empty(game, cast("SummableReward", reward))
    return WindowMemory(game, reward, MAX_WINDOW, padded=False)


def build_estimator(experiment: Experiment, game: Game, reward: RewardModel) -> GradientEstimator:
    """Build what learners estimate the gradient with.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm``.
    game : Game
        Of the experiment.
    reward : RewardModel
        r_theta.

    Returns
    -------
    GradientEstimator
        With a planner and an expectation of its own.
    """
    algorithm = experiment.algorithm
    planner = build("mabirds.planners", algorithm.policy, game, reward)
    expectation = game.expectation(algorithm.expectation or game.expectations[0], algorithm.rollouts)
    return GradientEstimator(game, reward, planner, expectation, algorithm.rollout_start)


def method_names() -> tuple[str, ...]:
    """Central methods that are installed."""
    return tuple(kinds(METHODS))


def build_method(experiment: Experiment, name: str, game: Game | None = None) -> "CentralMethod":
    """Build a central method.

    Parameters
    ----------
    experiment : Experiment
        With the settings of the method.
    name : str
        Of the method.
    game : Game, optional
        Of the experiment; saves building the same game again.

    Returns
    -------
    CentralMethod
        Before the first demonstration.

    Raises
    ------
    ExperimentError
        There is no such method, or it is not made for the experiment's game.
    """
    from mabirds_core.baselines.interface import MethodParts  # learners have no use for it

    kind, game, algorithm = require(METHODS, name), game or build_game(experiment), experiment.algorithm
    if kind.form not in {None, kind_of("mabirds.games", experiment.game).form}:
        raise ExperimentError(
            f"method {name} is made for {kind.form} games, and the game is {experiment.game.kind}; take another method"
        )
    parts = MethodParts(
        game=game,
        reward=build_reward(experiment, game),
        estimator=partial(build_estimator, experiment, game),
        steps=build("mabirds.step_rules", algorithm.steps),
        memory=partial(build_memory, experiment, game),
        seed=experiment.seed,
    )
    method: CentralMethod = kind.build(getattr(experiment.baselines, name), parts)
    return method


def reward_of(experiment: Experiment, name: str, game: Game) -> RewardModel | None:
    """r_theta of a learner or method.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm.reward``.
    name : str
        Of the learner or method.
    game : Game
        Of the experiment.

    Returns
    -------
    RewardModel or None
        None for a method that learns no parameters of a reward model.
    """
    if name in experiment.learners:
        return learners_reward(experiment, game)
    estimator = getattr(build_method(experiment, name, game), "estimator", None)
    return None if estimator is None else estimator.reward


def evaluation_policy(experiment: Experiment, name: str, game: Game) -> Callable[[Parameters], Policy]:
    """What theta and omega of a learner or method mean, whichever way it finds policies itself.

    Parameters
    ----------
    experiment : Experiment
        With ``algorithm``.
    name : str
        Of the learner or method, which may have its own reward, or its own policies.
    game : Game
        Says which planner finds out.

    Returns
    -------
    Callable[[Parameters], Policy]
        The policy of theta and omega.
    """
    method: Any = build_method(experiment, name, game) if name not in experiment.learners else None
    if method is not None and hasattr(method, "policy"):
        policy_of_method: Callable[[Parameters], Policy] = method.policy
        return policy_of_method
    reward = learners_reward(experiment, game) if method is None else method.estimator.reward
    return _policy_of(experiment, game.evaluation_planner(experiment.algorithm.policy, reward))


def _policy_of(experiment: Experiment, planner: Any) -> Callable[[Parameters], Policy]:
    return lambda parameters: planner.plan(*parameters, rng=np.random.default_rng(experiment.seed))
