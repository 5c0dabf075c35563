"""Pilots of the drone game that fly like people: smoothly, by no two alike ways, and carefully.

A demonstration begins at a start from P_0. Each drone's pilot chooses the side on which to pass the obstacle in
between, and a smooth way there (flight_paths.py); then, by step, with the pilot's own cruising speed c and lookahead l:

    wanted       c f (way(s + l) - p) / |way(s + l) - p| + n,    pure pursuit (Coulter 1992), n: AR(1) noise
    velocity     v + RESPONSE (wanted - v)

where s is how far along its way the drone at p is. The pilots' order is drawn: each slows down, to the largest
fraction f of its speed with which it comes near to none of the drones before it within ``foresight``. What violates a
constraint, leaves less than ``margin``, or does not arrive in time, is no demonstration and drawn again.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.errors import InfeasibleError
from mabirds_core.games.drones.flight_paths import LEFT, RIGHT, FlightPaths, PathPlanner, Side
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.geometry import swept_separation
from mabirds_core.games.interface import Trajectories

INTENTIONS, ATTEMPTS = 10, 20
"""Starts with sides that are drawn for a demonstration before giving up, and trajectories for each of them.

Only trajectories are drawn again as long as there is hope: starts and sides have the distribution they should have.
"""
LOOKAHEAD = 2.5
"""Steps at largest speed by which pure pursuit looks ahead."""
RESPONSE = 0.6
"""How much of the difference between the velocity wanted and the present one is made up for in a step."""
PERSISTENCE = 0.7
"""Correlation of the noise from one step to the next."""
FRACTIONS = np.array([1.0, 0.75, 0.5, 0.25, 0.0])
"""Fractions of its speed that a drone may slow down to."""
AIM = 0.5
"""Pilots aim at places within this fraction of their goal region's radius."""


class Intention(NamedTuple):
    """What stays when a trajectory is drawn again."""

    start: Array
    """A joint state, shape (N_E D,)."""
    sides: list[Side]


@dataclass(frozen=True)
class Pilots:
    """Draws demonstrations; see the module."""

    game: DroneGame
    side: str
    """By start: those who start left of the straight way from their start's middle to their goal region pass left."""
    cruise: tuple[float, float] = (0.88, 1.0)
    """Least and largest cruising speed, by the game's largest."""
    clearance: tuple[float, float] = (0.35, 0.55)
    """Least and largest distance from obstacles that pilots like to keep [m]."""
    noise: float = 0.08
    """Standard deviation of the noise of each component of the velocity, by the largest speed."""
    foresight: float = 2.5
    """How far pilots look into the future to yield [s]; 0: they do not care for each other."""
    yield_margin: float = 0.2
    """Beyond the least distance, what they want between them then [m]."""
    margin: float = 0.1
    """What a demonstration leaves to every obstacle, and beyond the least distance between drones [m]."""
    policy = None

    def demonstrations(self, count: int, rng: np.random.Generator) -> Iterator[Trajectories]:
        """Demonstrate one after the other, as ``demonstration`` does."""
        for _ in range(count):
            yield self.demonstration(rng)

    def demonstration(self, rng: np.random.Generator) -> Trajectories:
        """One demonstration.

        Raises
        ------
        InfeasibleError
            None comes about in so many attempts, or a drone has no way to its goal region.
        """
        self._check_ways()
        faults: Counter[str] = Counter()
        for _ in range(INTENTIONS):
            intention = self._intention(rng)
            for _ in range(ATTEMPTS):
                trajectory = self._trajectory(intention, rng)
                fault = self._fault(trajectory)
                if fault is None:
                    return trajectory
                faults[fault] += 1
        raise InfeasibleError(
            f"none of {faults.total()} trajectories will do as a demonstration:"
            f" {', '.join(f'{count} {fault}' for fault, count in faults.most_common())};"
            " make more room, raise the horizon, or lower the pilots' margin"
        )

    @cached_property
    def _planner(self) -> PathPlanner:
        return PathPlanner(self.game, self.margin)

    def _check_ways(self) -> None:
        for number, corridors in enumerate(self._planner.corridors, start=1):
            if not corridors:
                settings = self.game.settings
                raise InfeasibleError(
                    f"drone {number} has no way to its goal region that leaves {self.margin:g} m to the obstacles and"
                    f" takes at most {settings.horizon} steps of {settings.time_step:g} s at"
                    f" {settings.max_speed:g} m/s;"
                    " move the obstacles, the start or the goal region, or raise the horizon"
                )

    def _intention(self, rng: np.random.Generator) -> Intention:
        start = self.game.starts(1, rng)[0]
        wanted = self._wanted_sides(start, rng)
        return Intention(
            start, [side if side in self._planner.corridors[d] else -side for d, side in enumerate(wanted)]
        )

    def _wanted_sides(self, start: Array, rng: np.random.Generator) -> list[Side]:
        count = self.game.n_experts
        drawn = rng.choice([LEFT, RIGHT], size=count)
        match self.side:
            case "random":
                return [int(side) for side in drawn]
            case "by_start":
                return [self._planner.side_of(drone, place) for drone, place in enumerate(self.game.positions(start))]
        return [LEFT if self.side == "left" else RIGHT] * count

    def _trajectory(self, intention: Intention, rng: np.random.Generator) -> Trajectories:
        settings, paths = self.game.settings, self._paths(intention, rng)
        slowest, fastest = (fraction * settings.max_speed for fraction in self.cruise)
        needed = paths.lengths / (settings.horizon * settings.time_step)  # who has far to fly must hurry
        speeds = rng.uniform(np.clip(needed, slowest, fastest), fastest)
        return _Rollout(self, paths, speeds, rng.permutation(self.game.n_experts)).run(intention.start, rng)

    def _paths(self, intention: Intention, rng: np.random.Generator) -> FlightPaths:
        n, dynamics = self.game.n_experts, self.game.dynamics
        angle, radius = rng.uniform(0, 2 * np.pi, n), AIM * dynamics.goal_radii * np.sqrt(rng.uniform(size=n))
        aims = dynamics.goals + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        clearance = rng.uniform(*self.clearance, size=n)
        starts = self.game.positions(intention.start)
        return self._planner.paths(starts, np.clip(aims, 0.0, self.game.arena), intention.sides, clearance)

    def _fault(self, trajectory: Trajectories) -> str | None:
        """Why this is no demonstration."""
        if (self.game.obstacle_clearance(trajectory.states) < self.margin).any():
            return "came too near to an obstacle"
        if (self.game.separation_clearance(trajectory.states) < self.margin).any():
            return "came too near to each other"
        return None if self.game.arrived(trajectory.states[0, -1]).all() else "did not arrive in time"


@dataclass(frozen=True)
class _Rollout:
    """A trajectory under way: drones between their starts and their goal regions."""

    pilots: Pilots
    paths: FlightPaths
    speeds: Vector
    """Cruising speeds, shape (N_E,) [m/s]."""
    order: Indices
    """Drones from the one that yields to nobody to the one that yields to all, shape (N_E,)."""

    def run(self, start: Array, rng: np.random.Generator) -> Trajectories:
        """The trajectory from a joint state (N_E D,)."""
        game, steps = self.pilots.game, self.pilots.game.horizon + 1
        states, actions = np.empty((steps, game.state_size)), np.zeros((steps, game.action_size))
        noise = self.pilots.noise * game.settings.max_speed * correlated_noise(steps, game.n_experts, rng)
        arcs, velocities, states[0] = np.zeros(game.n_experts), np.zeros((game.n_experts, 2)), start
        for step in range(steps):
            places, arrived = game.positions(states[step]), game.arrived(states[step])
            if not arrived.all():
                arcs = self._progress(arcs, places)
                wanted = self._wanted(arcs, places, arrived) + noise[step]
                controls, velocities = self._controls(wanted, velocities, arrived)
                actions[step] = controls.ravel()
            if step < game.horizon:
                states[step + 1] = game.step(states[step], actions[step])
        return Trajectories(states[None], actions[None])

    @property
    def _reach(self) -> float:
        """How far a drone comes in a step at the most [m]."""
        settings = self.pilots.game.settings
        return settings.max_speed * settings.time_step

    @cached_property
    def _times(self) -> Vector:
        """From now until as far as pilots look into the future [s]; only now: they do not."""
        step = self.pilots.game.settings.time_step
        return step * np.arange(np.ceil(self.pilots.foresight / step) + 1)

    def _progress(self, arcs: Vector, places: Array) -> Vector:
        """How far along their ways the drones are: where these are nearest, at most two steps on, shape (N_E,)."""
        ahead = arcs[:, None] + self._reach * np.linspace(0.0, 2.0, 17)
        nearest = ((self.paths.at(ahead) - places[:, None]) ** 2).sum(axis=-1).argmin(axis=1)
        return np.asarray(ahead[np.arange(len(arcs)), nearest])

    def _wanted(self, arcs: Vector, places: Array, arrived: Mask) -> Array:
        """Velocities without noise, shape (N_E, 2)."""
        targets = self.paths.at(arcs[:, None] + LOOKAHEAD * self._reach)[:, 0]
        way = targets - places
        distance = np.maximum(np.hypot(*way.T), 1e-9)
        speeds = self.speeds * self._fractions(arcs, places, arrived)
        return np.asarray(way * (speeds / distance)[:, None])

    def _fractions(self, arcs: Vector, places: Array, arrived: Mask) -> Vector:
        """To which fraction of its speed each drone slows down to yield, shape (N_E,)."""
        chosen = np.where(arrived, len(FRACTIONS) - 1, 0)
        if len(self._times) > 1:
            futures = self._futures(arcs, places)
            order = sorted(self.order, key=lambda drone: not arrived[drone])
            for rank, drone in enumerate(order):
                if rank > 0 and not arrived[drone]:
                    before = order[:rank]
                    chosen[drone] = self._best(futures[drone], futures[before, chosen[before]])
        return np.asarray(FRACTIONS[chosen])

    def _futures(self, arcs: Vector, places: Array) -> Array:
        """Where each drone will be with each of the FRACTIONS, shape (N_E, F, times, 2)."""
        ahead = self.speeds[:, None, None] * FRACTIONS[:, None] * self._times
        n = len(arcs)
        ways = self.paths.at((arcs[:, None, None] + ahead).reshape(n, -1)).reshape(n, len(FRACTIONS), -1, 2)
        return np.asarray(ways + (places - self.paths.at(arcs[:, None])[:, 0])[:, None, None])

    def _best(self, futures: Array, others: Array) -> int:
        """Which of one drone's futures (F, times, 2) to choose in view of those of others (k, times, 2)."""
        candidates, other = futures[:, None], others[None]
        apart = swept_separation(
            (candidates[..., :-1, :], other[..., :-1, :]), (candidates[..., 1:, :], other[..., 1:, :])
        )
        least = apart.min(axis=(1, 2))
        free = np.flatnonzero(least >= self.pilots.game.settings.least_distance + self.pilots.yield_margin)
        return int(free[0] if len(free) else least.argmax())

    def _controls(self, wanted: Array, velocities: Array, arrived: Mask) -> tuple[Array, Array]:
        """Actions of the drones (N_E, 2), none in the goal region, and the velocities that follow."""
        dynamics, step = self.pilots.game.dynamics, self.pilots.game.settings.time_step
        after = _at_most(velocities + RESPONSE * (wanted - velocities), dynamics.max_speed)
        after[arrived] = 0.0
        if dynamics.max_acceleration is None:
            return after, after
        controls = _at_most((after - velocities) / step, dynamics.max_acceleration)
        controls[arrived] = 0.0
        return controls, _at_most(velocities + step * controls, dynamics.max_speed)


def correlated_noise(steps: int, drones: int, rng: np.random.Generator) -> Array:
    """AR(1) noise of variance 1.

    Parameters
    ----------
    steps : int
        How many.
    drones : int
        How many.
    rng : np.random.Generator
        Of the noise.

    Returns
    -------
    Array
        Shape (steps, drones, 2).
    """
    noise = rng.standard_normal((steps, drones, 2))
    for step in range(1, steps):
        noise[step] = PERSISTENCE * noise[step - 1] + np.sqrt(1 - PERSISTENCE**2) * noise[step]
    return noise


def _at_most(vectors: Array, longest: float) -> Array:
    """Vectors (k, 2), truncated where they are longer."""
    length = np.hypot(*vectors.T)[:, None]
    return np.asarray(vectors * np.where(length > longest, longest / np.maximum(length, 1e-300), 1.0))
