"""Cost features of the user's own, and what experts really pay: expressions over where patrollers are.

Of experts i, j = 1..N_E an expression may name

    row_i, column_i     of the cell
    present_i           0 where the expert has left by an exit, else 1
    distance_i_j        Euclidean, in cells, i < j; infinite where one of the two has left
    distance            the smallest of these; infinite for one expert alone
    LAYER_i             what a layer of the map, given in the file, says of the cell; 0 where the expert has left

Packages bring others, by entry points: ``build(settings, places)`` is given JointPlaces.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations
from typing import Any, cast

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.expressions import Expression
from mabirds_core.games.patrol.geometry import PatrolGrid
from mabirds_core.registry import build

QUANTITIES = ("row", "column", "present", "distance")
"""What every patrol has."""

FEATURES = "mabirds.cost_features"
"""Entry points of further ones."""

Layers = Mapping[str, tuple[tuple[float, ...], ...]]
"""Numbers of all cells by name, rows from top to bottom."""


def quantity_names(n_experts: int, layers: Layers) -> frozenset[str]:
    """What expressions may name.

    Parameters
    ----------
    n_experts : int
        N_E.
    layers : Layers
        Of the map.

    Returns
    -------
    frozenset[str]
        All names.
    """
    experts = range(1, n_experts + 1)
    own = (f"{name}_{i}" for name in (*QUANTITIES[:-1], *layers) for i in experts)
    return frozenset(own) | {f"distance_{i}_{j}" for i, j in combinations(experts, 2)} | {"distance"}


@dataclass(frozen=True)
class JointPlaces:
    """Where patrollers are in every joint state: what cost features are made of.

    Attributes
    ----------
    rows : Array
        Of the cells, shape (N_E, S).
    columns : Array
        Likewise, shape (N_E, S).
    present : Mask
        Who has not left by an exit, shape (N_E, S).
    layers : Mapping[str, Array]
        What layers of the map say of the cells, 0 for those who have left; shape (N_E, S) each.
    """

    rows: Array
    columns: Array
    present: Mask
    layers: Mapping[str, Array]

    @cached_property
    def quantities(self) -> Mapping[str, Vector]:
        """What expressions may name, shape (S,) each."""
        return dict(chain(self._of_experts(), self._distances()))

    def _of_experts(self) -> Iterator[tuple[str, Vector]]:
        of_all = {"row": self.rows, "column": self.columns, "present": self.present.astype(np.float64), **self.layers}
        for i in range(len(self.rows)):
            yield from ((f"{name}_{i + 1}", values[i]) for name, values in of_all.items())

    def _distances(self) -> Iterator[tuple[str, Vector]]:
        smallest = np.full(self.rows.shape[1], np.inf)
        for i, j in combinations(range(len(self.rows)), 2):
            apart = np.sqrt((self.rows[i] - self.rows[j]) ** 2 + (self.columns[i] - self.columns[j]) ** 2)
            apart[~(self.present[i] & self.present[j])] = np.inf
            smallest = np.minimum(smallest, apart)
            yield f"distance_{i + 1}_{j + 1}", apart
        yield "distance", smallest


def joint_places(grid: PatrolGrid, layers: Layers) -> JointPlaces:
    """Where patrollers are.

    Parameters
    ----------
    grid : PatrolGrid
        Where experts can be.
    layers : Layers
        Of the map.

    Returns
    -------
    JointPlaces
        Of every joint state.
    """
    cells = grid.cells(np.arange(grid.n_states))
    rows, columns = (part.astype(np.float64) for part in np.divmod(cells, grid.width))
    present = np.stack([here[own] for here, own in zip(grid.present, cells, strict=True)])
    of_cells = {name: np.array(layer, dtype=np.float64).ravel() for name, layer in layers.items()}
    return JointPlaces(rows, columns, present, {name: layer[cells] * present for name, layer in of_cells.items()})


def named_features(grid: PatrolGrid, costs: Mapping[str, Any], layers: Layers) -> dict[str, Vector]:
    """The features of every joint state.

    Parameters
    ----------
    grid : PatrolGrid
        Where experts can be.
    costs : Mapping[str, Any]
        By name: expressions, or settings of kinds of FEATURES.
    layers : Layers
        Of the map.

    Returns
    -------
    dict[str, Vector]
        By name, shape (S,) each.

    Raises
    ------
    ValueError
        A feature has no finite value in some joint state, or is of another shape.
    """
    places = joint_places(grid, layers) if costs else None
    return {name: _evaluated(grid, name, cost, cast("JointPlaces", places)) for name, cost in costs.items()}


def _evaluated(grid: PatrolGrid, name: str, cost: Any, places: JointPlaces) -> Vector:
    words = repr(cost) if isinstance(cost, str) else f"of kind {cost.kind!r}"
    if isinstance(cost, str):
        values = np.broadcast_to(Expression(cost)(places.quantities), grid.n_states).astype(np.float64)
    else:
        values = np.asarray(build(FEATURES, cost, places), dtype=np.float64)
    if values.shape != (grid.n_states,):
        raise ValueError(f"{name} {words}: values of shape {values.shape}, expected ({grid.n_states},)")
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        cells = [tuple(int(x) for x in divmod(int(cell), grid.width)) for cell in grid.cells(wrong[:1])[:, 0]]
        raise ValueError(
            f"{name} {words}: {values[wrong[0]]} where the experts are in {cells}; expected finite"
            " numbers everywhere, as of 1 / (1 + distance)"
        )
    return values
