"""What studies of drones ask of an experiment."""

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.judge import EVAL_ROLLOUTS
from mabirds_core.games.drones.rollouts import DronePolicy
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Trajectories


def drone_game(experiment: Experiment) -> WholeDroneGame:
    """The experiment's game; raises ExperimentError where it is another."""
    game = build_game(experiment)
    if not isinstance(game, WholeDroneGame):
        kind = experiment.game.kind
        raise ExperimentError(f"{experiment.name}: the game is {kind}, expected drones; give another experiment file")
    return game


def eval_rollouts(
    experiment: Experiment, game: WholeDroneGame, policy: DronePolicy, count: int = EVAL_ROLLOUTS
) -> Trajectories:
    """Rollouts of a policy, the same for every learner and iteration but for what it decides."""
    return game.judge.rollouts(policy, experiment.seed, count)
