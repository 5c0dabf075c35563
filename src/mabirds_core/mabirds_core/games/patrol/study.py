"""What studies of patrols ask of an experiment."""

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.patrol.whole_game import WholePatrolGame


def patrol_game(experiment: Experiment) -> WholePatrolGame:
    """The experiment's game; raises ExperimentError where it is another."""
    game = build_game(experiment)
    if not isinstance(game, WholePatrolGame):
        kind = experiment.game.kind
        raise ExperimentError(f"{experiment.name}: the game is {kind}, expected patrol; give another experiment file")
    return game
