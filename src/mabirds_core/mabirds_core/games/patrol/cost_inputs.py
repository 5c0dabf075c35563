"""What patrols tell a cost network of their joint states, each from -1 to 1.

row_i, column_i     of the cell, from the first to the last
present_i           -1 where the expert has left by an exit, where that can be
distance_i_j        Euclidean, -1 in one cell; 1 as far as can be, and where one of the two has left
near_i_j            2 / (1 + distance in cells) - 1: what is near is told apart better
LAYER_i, NAME       layers of the map, and the file's own cost features, by their largest absolute value
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector, weighted_counts
from mabirds_core.costs.network import StateRewards, Visits, main_effects
from mabirds_core.games.factored import FactoredReward
from mabirds_core.games.interface import Visitation
from mabirds_core.games.patrol.geometry import PatrolGrid
from mabirds_core.games.patrol.named_costs import Layers, joint_places
from mabirds_core.planners.factored import FactoredVisitation


@dataclass(frozen=True, eq=False)
class PatrolCostInputs:
    """``costs.network.CostInputs`` of patrols; meetings on the way are swaps.

    Attributes
    ----------
    grid : PatrolGrid
        Where experts can be.
    layers : Layers
        Of the map.
    named : Mapping[str, Vector]
        The file's own cost features, shape (S,) each.
    joint_scale : float
        Of the game's features for sharing and swapping.
    chosen : Sequence[str] or None
        Names of inputs; None: all.
    """

    grid: PatrolGrid
    layers: Layers
    named: Mapping[str, Vector]
    joint_scale: float = 1.0
    chosen: Sequence[str] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inputs."""
        return tuple(self.chosen or self._every)

    @cached_property
    def values(self) -> Array:
        """x(s), shape (S, D)."""
        return np.column_stack([self._every[name] for name in self.names])

    @cached_property
    def places(self) -> Indices:
        """places[i, s]: the cell of expert i, and of all who have left the same one; shape (N_E, S)."""
        return np.stack([own[cells] for own, cells in zip(self._one_outside, self._cells, strict=True)])

    @cached_property
    def _cells(self) -> Indices:
        return self.grid.cells(np.arange(self.grid.n_states))

    @property
    def _one_outside(self) -> list[Indices]:
        """By expert and cell: the cell, or the first by which the expert leaves."""
        every = np.arange(self.grid.n_cells)
        return [np.where(here, every, np.argmin(here)) for here in self.grid.present]

    @cached_property
    def _every(self) -> dict[str, Vector]:
        inputs = dict[str, Vector]()
        for name, values in joint_places(self.grid, self.layers).quantities.items():
            kind, _, whose = name.partition("_")
            if kind == "distance" and whose:
                inputs[name] = _scaled(values, 0.0, np.hypot(self.grid.height - 1, self.grid.width - 1))
                inputs[f"near_{whose}"] = 2 / (1 + values) - 1
            elif kind in ("row", "column"):
                inputs[name] = _scaled(values, 0.0, (self.grid.height if kind == "row" else self.grid.width) - 1)
            elif kind != "distance" and not (kind == "present" and values.all()):
                inputs[name] = _signed(values)
        return inputs | {name: _signed(values) for name, values in self.named.items()}

    def visits(self, visitation: Visitation) -> Visits:
        """Joint states, and swaps."""
        if isinstance(visitation, FactoredVisitation):
            totals = visitation.totals
            return Visits(totals.states, float((totals.levels * np.arange(len(totals.levels))).sum()))
        states, actions, weights = visitation
        swaps = (weights * self.grid.swapping_in(states, actions)).sum()
        return Visits(weighted_counts(states, weights, self.grid.n_states), float(swaps))

    def table(self, rewards: StateRewards) -> Array:
        """At every joint state and action, shape (S, A)."""
        return np.asarray(rewards.states[:, None] + rewards.meeting * self.grid.swapping)

    def factored(self, rewards: StateRewards) -> FactoredReward:
        """By expert: all of it hangs on joint states."""
        grid = self.grid
        moves = np.zeros((grid.n_experts, grid.n_cells, grid.n_moves))
        return FactoredReward(moves, rewards.states, rewards.meeting * np.arange(grid.n_pairs + 1.0))

    def by_feature(self, rewards: StateRewards) -> Vector:
        """Cells by their main effects, 0 for the best; sharing by what it adds to them on average; named ones by 0."""
        effects, sharing = main_effects(rewards.states, self._cells), self.grid.sharing
        alone = rewards.states.mean() + sum(effect[own] for effect, own in zip(effects, self._cells, strict=True))
        shared = ((rewards.states - alone) * sharing).sum() / max(1, (sharing**2).sum())
        cells = [(effect - effect.max()) * here for effect, here in zip(effects, self.grid.present, strict=True)]
        joint = np.array([shared, rewards.meeting]) / self.joint_scale
        return np.concatenate([*cells, joint, np.zeros(len(self.named))])


def _scaled(values: Vector, least: float, most: float) -> Vector:
    """From -1 at ``least`` to 1 at ``most`` and beyond."""
    return 2 * (np.minimum(values, most) - least) / max(most - least, 1.0) - 1


def _signed(values: Vector) -> Vector:
    """Divided by the largest absolute value."""
    return values / max(float(np.abs(values).max()), np.finfo(np.float64).tiny)
