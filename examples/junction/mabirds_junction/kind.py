"""What the entry points name."""

from typing import Literal

from mabirds_core.errors import ExperimentError
from mabirds_core.games.whole_game import Game
from mabirds_core.registry import Kind
from mabirds_core.settings import Settings
from mabirds_junction.game import JunctionGame
from mabirds_junction.progress import ProgressReward
from mabirds_junction.settings import JunctionSettings


class ProgressSettings(Settings):
    """r_theta by how far vehicles have come."""

    kind: Literal["progress"]


def build_progress(settings: ProgressSettings, game: Game) -> ProgressReward:
    """The reward of a junction; raises ExperimentError for other games."""
    if not isinstance(game, JunctionGame):
        raise ExperimentError(f"algorithm.reward {settings.kind}: made for games of kind junction; take linear")
    return ProgressReward(game.lanes)


JUNCTION = Kind(JunctionSettings, JunctionGame, form="tabular")
PROGRESS = Kind(ProgressSettings, build_progress)
