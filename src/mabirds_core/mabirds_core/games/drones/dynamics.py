"""How drones move, for numpy and torch alike: the same lines work on the arrays of either.

    single integrator:  p' = p + dt a                               |a| <= max_speed
    double integrator:  v' = v + dt a,  p' = p + dt v'              |a| <= max_acceleration, |v'| <= max_speed

Longer actions and velocities are truncated, and walls stop a drone. One that is in its goal region stays as it is, at
rest.
"""

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from mabirds_core.games.drones.geometry import squared_length
from mabirds_core.games.drones.settings import DroneSettings


@dataclass(frozen=True)
class DroneDynamics:
    """The dynamics, with its constants as arrays of ``library``."""

    library: Any
    """numpy or torch."""
    arena: Any
    """Width and depth, shape (2,) [m]."""
    goals: Any
    """Centres of the goal regions, shape (N_E, 2) [m]."""
    goal_radii: Any
    """Their radii, shape (N_E,) [m]."""
    goal_ways: Any
    """From one end of each door to the other, shape (N_E, 2) [m]; None where all goal regions are discs."""
    time_step: float
    max_speed: float
    max_acceleration: float | None
    """None: single integrators."""

    @classmethod
    def of(cls, settings: DroneSettings) -> Self:
        """The dynamics of ``settings`` with arrays of numpy."""
        regions = [task.goal_region for task in settings.drones]
        doors = any(region.until is not None for region in regions)
        double = settings.dynamics == "double_integrator"
        return cls(
            np,
            np.array(settings.arena),
            np.array([region.centre for region in regions]),
            np.array([region.radius for region in regions]),
            np.array([region.way for region in regions]) if doors else None,
            settings.time_step,
            settings.max_speed,
            settings.max_acceleration if double else None,
        )

    def on(self, device: Any, dtype: Any) -> Self:
        """The same with tensors of torch.

        Parameters
        ----------
        device : Any
            Of the tensors.
        dtype : Any
            Of the tensors.

        Returns
        -------
        Self
            With the same constants.
        """
        import torch

        constants = (self.arena, self.goals, self.goal_radii)
        arena, goals, radii = (torch.as_tensor(values, device=device, dtype=dtype) for values in constants)
        ways = None if self.goal_ways is None else torch.as_tensor(self.goal_ways, device=device, dtype=dtype)
        return replace(self, library=torch, arena=arena, goals=goals, goal_radii=radii, goal_ways=ways)

    def of_drone(self, drone: int) -> Self:
        """That of one drone alone.

        Parameters
        ----------
        drone : int
            Index i.

        Returns
        -------
        Self
            With N_E = 1.
        """
        only = slice(drone, drone + 1)
        ways = None if self.goal_ways is None else self.goal_ways[only]
        return replace(self, goals=self.goals[only], goal_radii=self.goal_radii[only], goal_ways=ways)

    @property
    def drone_size(self) -> int:
        """D: numbers in the state of one drone."""
        return 2 if self.max_acceleration is None else 4

    @property
    def max_action(self) -> float:
        """The largest length of an action."""
        return self.max_speed if self.max_acceleration is None else self.max_acceleration

    @property
    def reach(self) -> float:
        """How far a drone flies in a time step, at most [m]."""
        return self.time_step * self.max_speed

    @property
    def action_unit(self) -> str:
        """Unit of an action, for people."""
        return "m/s" if self.max_acceleration is None else "m/s^2"

    def step(self, drones: Any, controls: Any) -> Any:
        """Move all drones by a time step.

        Parameters
        ----------
        drones : Any
            States, shape (..., N_E, D).
        controls : Any
            Actions, shape (..., N_E, 2).

        Returns
        -------
        Any
            The states that follow, shape (..., N_E, D).
        """
        lib, place = self.library, drones[..., :2]
        limited = self._shortened(controls, self.max_action)
        single = self.max_acceleration is None
        velocity = limited if single else self._shortened(drones[..., 2:] + self.time_step * limited, self.max_speed)
        there = self.arrived(place)[..., None]
        moved = place + self.time_step * velocity
        moved = lib.minimum(lib.maximum(moved, lib.zeros_like(self.arena)), self.arena)
        after = lib.where(there, place, moved)
        if single:
            return after
        return lib.concatenate((after, lib.where(there, lib.zeros_like(velocity), velocity)), -1)

    def arrived(self, places: Any) -> Any:
        """Which drones, (..., N_E, 2), are in their goal regions, shape (..., N_E)."""
        away = places - self.goals
        if self.goal_ways is not None:
            ways, squares = self.goal_ways, squared_length(self.goal_ways)
            along = (away * ways).sum(-1) / self.library.where(squares > 0, squares, self.library.ones_like(squares))
            away = away - self.library.clip(along, 0.0, 1.0)[..., None] * ways
        return squared_length(away) <= self.goal_radii**2

    def _shortened(self, vectors: Any, longest: float) -> Any:
        """Vectors (..., 2) that are too long, at their largest length."""
        length = self.library.sqrt(squared_length(vectors))[..., None]
        return vectors * self.library.where(
            length > longest, longest / self.library.where(length > longest, length, 1.0), 1.0
        )
