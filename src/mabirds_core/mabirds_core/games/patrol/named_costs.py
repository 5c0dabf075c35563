"""Cost features of the user's own, and what experts really pay: expressions over where patrollers are.

Of experts i, j = 1..N_E an expression may name

    row_i, column_i     of the cell
    present_i           0 where the expert has left by an exit, else 1
    distance_i_j        Euclidean, in cells, i < j; infinite where one of the two has left
    distance            the smallest of these; infinite for one expert alone
    LAYER_i             what a layer of the map, given in the file, says of the cell; 0 where the expert has left
"""

from collections.abc import Iterator, Mapping
from itertools import combinations

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.expressions import Expression
from mabirds_core.games.patrol.geometry import PatrolGrid

QUANTITIES = ("row", "column", "present", "distance")
"""What every patrol has."""

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


def named_features(grid: PatrolGrid, costs: Mapping[str, str], layers: Layers) -> dict[str, Vector]:
    """The features of every joint state.

    Parameters
    ----------
    grid : PatrolGrid
        Where experts can be.
    costs : Mapping[str, str]
        Expressions by name.
    layers : Layers
        Of the map.

    Returns
    -------
    dict[str, Vector]
        By name, shape (S,) each.

    Raises
    ------
    ValueError
        An expression has no finite value in some joint state.
    """
    values = dict(quantities(grid, layers)) if costs else {}
    return {name: _evaluated(grid, name, Expression(text), values) for name, text in costs.items()}


def _evaluated(grid: PatrolGrid, name: str, expression: Expression, quantities: Mapping[str, Array]) -> Vector:
    values = np.broadcast_to(expression(quantities), grid.n_states).astype(np.float64)
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        cells = [tuple(int(x) for x in divmod(int(cell), grid.width)) for cell in grid.cells(wrong[:1])[:, 0]]
        raise ValueError(
            f"{name} {expression.text!r}: {values[wrong[0]]} where the experts are in {cells}; expected finite"
            " numbers everywhere, as of 1 / (1 + distance)"
        )
    return values


def quantities(grid: PatrolGrid, layers: Layers) -> Iterator[tuple[str, Vector]]:
    """All that expressions may name.

    Parameters
    ----------
    grid : PatrolGrid
        Where experts can be.
    layers : Layers
        Of the map.

    Yields
    ------
    tuple[str, Vector]
        A name, and the quantity in every joint state, shape (S,).
    """
    cells = grid.cells(np.arange(grid.n_states))
    rows, columns = (part.astype(np.float64) for part in np.divmod(cells, grid.width))
    present = np.stack([here[own] for here, own in zip(grid.present, cells, strict=True)])
    for i in range(grid.n_experts):
        yield f"row_{i + 1}", rows[i]
        yield f"column_{i + 1}", columns[i]
        yield f"present_{i + 1}", present[i].astype(np.float64)
        for name, layer in layers.items():
            yield f"{name}_{i + 1}", np.array(layer, dtype=np.float64).ravel()[cells[i]] * present[i]
    smallest = np.full(grid.n_states, np.inf)
    for i, j in combinations(range(grid.n_experts), 2):
        apart = np.sqrt((rows[i] - rows[j]) ** 2 + (columns[i] - columns[j]) ** 2)
        apart[~(present[i] & present[j])] = np.inf
        smallest = np.minimum(smallest, apart)
        yield f"distance_{i + 1}_{j + 1}", apart
    yield "distance", smallest
