"""The patrol game with what reports and players ask of it, each part loaded by who asks: learners do not."""

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.whole_game import Learned

if TYPE_CHECKING:
    from mabirds_core.games.patrol.held_out import HeldOutPatrols
    from mabirds_core.games.patrol.scene import PatrolScene
    from mabirds_core.games.recordings import Fit


class WholePatrolGame(PatrolGame):
    """``games.whole_game.Game`` of patrols."""

    @cached_property
    def scene(self) -> "PatrolScene":
        """The map from above."""
        from mabirds_core.games.patrol.scene import PatrolScene

        return PatrolScene(self)

    def fit_places(self, places: Array) -> "Fit":
        """The patrol that follows recorded places."""
        from mabirds_core.games.patrol.recorded import fit_places

        return fit_places(self, places)

    @property
    def residual_limit(self) -> float:
        """A cell: its corners are .7 of it from its middle."""
        return self.settings.cell or 0.0

    @property
    def held_out_judge(self) -> "HeldOutPatrols":
        """Who compares policies with patrols that nobody learned from."""
        from mabirds_core.games.patrol.held_out import HeldOutPatrols

        return HeldOutPatrols(self)

    def measures(self, omega: Vector, demonstrations: Trajectories) -> Mapping[str, Mapping[str, float]]:  # noqa: ARG002
        """What a network has learned experts to cost each other."""
        from mabirds_core.games.patrol.cost_shapes import cost_measures

        return cost_measures(self, omega)

    def figure(self, learned: Mapping[str, Learned], threshold: float, seed: int) -> Any:  # noqa: ARG002
        """A map of each expert for each name: visits, and what counts as forbidden."""
        from mabirds_core.games.patrol.pictures import map_figure  # matplotlib is for reports

        return map_figure(self, learned)

    def demonstrations_figure(self, demonstrations: Trajectories) -> Any:
        """A map of each expert with the ways that it took in the first demonstrations."""
        from mabirds_core.games.patrol.pictures import demonstrations_figure

        return demonstrations_figure(self, demonstrations)
