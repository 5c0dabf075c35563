"""What the numbers in theta and omega are called."""

from typing import NamedTuple

from mabirds_core.costs.models import costs_of
from mabirds_core.experiment.assembly import reward_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.whole_game import Game


class ParameterNames(NamedTuple):
    """Names for people.

    Attributes
    ----------
    theta : tuple[str, ...]
        One for each reward parameter; empty where they have no meaning of their own, as those of a network.
    omega : tuple[str, ...]
        One for each cost feature; empty where omega are weights of a network.
    """

    theta: tuple[str, ...]
    omega: tuple[str, ...]


def parameter_names(experiment: Experiment, name: str, game: Game) -> ParameterNames:
    """Name the parameters of a learner or method.

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
    ParameterNames
        As learners publish them.
    """
    reward = reward_of(experiment, name, game)
    named = reward if hasattr(reward, "names") else getattr(reward, "features", None)
    of_features = tuple(getattr(named, "names", ()))
    theta = of_features if reward is not None and len(of_features) == reward.size else ()
    return ParameterNames(theta, costs_of(game).names)
