"""Cost features of the user's own: expressions of one drone, or of two drones' distance.

    x, y        place of a drone [m]
    speed       of a drone [m/s]
    distance    of two drones [m]

As they stand they are of every drone, or of every two, and summed; with numbers (x_1, distance_1_2), of those alone.
An expression is of one drone or of one distance: policies are planned drone by drone, and two drones are coupled by
their distance alone.
"""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.expressions import Expression
from mabirds_core.games.drones.space import DroneSpace

NAME = re.compile(r"(?P<what>x|y|speed)(_(?P<drone>\d+))?|distance(_(?P<first>\d+)_(?P<second>\d+))?")

POINTS = 25
"""Of each quantity, at which an expression must have a value."""


@dataclass(frozen=True)
class NamedCost:
    """One such feature.

    Attributes
    ----------
    expression : Expression
        Of the names.
    drones : Collection[int]
        Of whose places and speeds; none where it is of distances.
    pairs : Collection[int]
        Of which pairs' distances.
    """

    expression: Expression
    drones: Collection[int]
    pairs: Collection[int]

    def of_drone(self, states: Array, actions: Array) -> Array:
        """Its value for one drone.

        Parameters
        ----------
        states : Array
            Of the drone, shape (..., D).
        actions : Array
            Of the drone, shape (..., 2); of a shape that fits.

        Returns
        -------
        Array
            Shape (...).
        """
        velocities = states[..., 2:] if states.shape[-1] > 2 else actions  # of single integrators they are actions
        speed = np.sqrt((velocities**2).sum(axis=-1))
        known = {"x": states[..., 0], "y": states[..., 1], "speed": speed}
        return self.expression({name: known[name.partition("_")[0]] for name in self.expression.names})

    def of_distance(self, distances: Array) -> Array:
        """Its value for two drones, of the shape of their ``distances`` [m]."""
        return self.expression(dict.fromkeys(self.expression.names, distances))


def named_costs(space: DroneSpace, costs: Mapping[str, str]) -> list[NamedCost]:
    """Read expressions.

    Parameters
    ----------
    space : DroneSpace
        Of the drones.
    costs : Mapping[str, str]
        Expressions by name.

    Returns
    -------
    list[NamedCost]
        In order.

    Raises
    ------
    ValueError
        An expression is of something else.
    """
    return [_read(space, name, Expression(text)) for name, text in costs.items()]


def check_values(space: DroneSpace, max_speed: float, costs: Mapping[str, str]) -> None:
    """Check that expressions have finite values all over the arena, at all speeds and distances.

    Parameters
    ----------
    space : DroneSpace
        With the arena.
    max_speed : float
        The fastest [m/s].
    costs : Mapping[str, str]
        Expressions by name.

    Raises
    ------
    ValueError
        One has not, or is of something else.
    """
    sides = (*space.sides, max_speed)
    x, y, speed = (grid.ravel() for grid in np.meshgrid(*(np.linspace(0, side, POINTS) for side in sides)))
    states, actions = np.stack([x, y], axis=1), np.stack([speed, np.zeros_like(speed)], axis=1)
    distances = np.linspace(0, float(np.hypot(*space.sides)), POINTS)
    for name, cost in zip(costs, named_costs(space, costs), strict=True):
        values = cost.of_drone(states, actions) if cost.drones else cost.of_distance(distances)
        if not np.isfinite(values).all():
            raise ValueError(f"costs.{name} {cost.expression.text!r}: expected finite numbers everywhere in the arena")


def _read(space: DroneSpace, name: str, expression: Expression) -> NamedCost:
    found = {NAME.fullmatch(quantity) for quantity in expression.names}
    whose = {tuple(match.group("drone", "first", "second")) for match in found if match}
    kinds = {match.group("what") is None for match in found if match}
    if None in found or len(whose) != 1 or len(kinds) != 1:
        raise ValueError(
            f"costs.{name} {expression.text!r}: expected x, y and speed of every drone or of one (x_1), or the distance"
            " of every two or of two (distance_1_2), and no two of these in one expression"
        )
    drone, *pair = (None if number is None else int(number) - 1 for number in whose.pop())
    drones, pairs = range(space.n_experts), space.pairs
    if kinds == {True}:
        chosen = [k for k, these in enumerate(pairs) if pair in ([None, None], [*these])]
        if not chosen:
            raise ValueError(f"costs.{name} {expression.text!r}: there is no such pair of drones, the lower first")
        return NamedCost(expression, (), chosen)
    if drone is not None and drone not in drones:
        raise ValueError(f"costs.{name} {expression.text!r}: expected a drone from 1 to {space.n_experts}")
    return NamedCost(expression, drones if drone is None else (drone,), ())
