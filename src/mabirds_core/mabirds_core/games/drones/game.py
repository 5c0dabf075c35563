"""The drone game (paper, section 5.2): drones fly to their goal regions past obstacles and each other.

A joint state is the drones' states one after the other: x, y [m], for double integrators also vx, vy [m/s]. A joint
action is their velocities [m/s] or accelerations [m/s^2], each of at most the largest length. Between two steps a
drone flies straight on. Walls stop drones; a drone that has reached its goal region stays there for ever. What may not
be: touching an obstacle, and coming closer to another drone than the least distance, at the steps or between them.
"""

from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Mask
from mabirds_core.digest import trajectory_digest
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.drones.dynamics import DroneDynamics
from mabirds_core.games.drones.features import DroneCostFeatures, DroneRewardFeatures
from mabirds_core.games.drones.geometry import swept_separation
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.space import DroneSpace
from mabirds_core.games.interface import Trajectories

TOLERANCE = 1e-6
"""By how much a demonstrated step may miss what the dynamics say, in metres and metres per second."""


class DroneGame:
    """N_E drones of D numbers each: joint states (..., N_E D), joint actions (..., 2 N_E).

    Parameters
    ----------
    settings : DroneSettings
        Of the game.
    """

    def __init__(self, settings: DroneSettings) -> None:
        self.settings = settings
        self.n_experts = settings.n_experts
        self.horizon = settings.horizon
        self.discount = settings.discount
        self.dynamics = DroneDynamics.of(settings)
        self.space = space = DroneSpace(settings.arena, settings.n_experts, self.dynamics.drone_size)
        self.state_size, self.action_size = space.state_size, space.action_size
        self.arena, self.pairs = space.arena, space.pairs
        self.drones, self.positions, self.controls = space.drones, space.positions, space.controls

    @cached_property
    def digest(self) -> str:
        """Digest of the arena, how drones move in it, and the goal regions where they stay; obstacles bind nobody."""
        left_out = {"library", *(["goal_ways"] if self.dynamics.goal_ways is None else [])}  # bags are older than doors
        constants = {name: value for name, value in vars(self.dynamics).items() if name not in left_out}
        plain = {name: np.asarray(value).tolist() for name, value in constants.items()}
        return trajectory_digest("drones", plain, self.horizon)

    def starts(self, count: int, rng: np.random.Generator) -> Array:
        """Draw joint states from P_0: uniform in the starts' squares within the arena, at rest.

        Parameters
        ----------
        count : int
            How many.
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        Array
            Shape (count, N_E D).
        """
        corners = np.array([task.start_corners for task in self.settings.drones])
        low, high = np.clip(np.moveaxis(corners, 1, 0), 0.0, self.arena)
        states = np.zeros((count, self.n_experts, self.dynamics.drone_size))
        states[..., :2] = rng.uniform(low, high, size=(count, self.n_experts, 2))
        return states.reshape(count, self.state_size)

    def step(self, states: Array, actions: Array) -> Array:
        """The joint states that follow.

        Parameters
        ----------
        states : Array
            Shape (..., N_E D).
        actions : Array
            Shape (..., 2 N_E).

        Returns
        -------
        Array
            Shape (..., N_E D).
        """
        after = self.dynamics.step(self.drones(states), self.controls(actions))
        return np.asarray(after).reshape(states.shape)

    def arrived(self, states: Array) -> Mask:
        """Which drones are in their goal regions, shape (..., N_E)."""
        return np.asarray(self.dynamics.arrived(self.positions(states)))

    @cached_property
    def cost_features(self) -> DroneCostFeatures:
        """phi: RBFs of each drone's place, steps of two drones' distance, each drone's effort, the user's own."""
        return DroneCostFeatures(self.space, self.settings, self.dynamics.max_action)

    @cached_property
    def reward_features(self) -> DroneRewardFeatures:
        """f: wider RBFs of each drone's place."""
        return DroneRewardFeatures(self.space, self.settings.features)

    @cached_property
    def true_constraints(self) -> Mask | None:
        """RBFs at whose centre a drone would touch an obstacle, and steps at distances that are too small.

        None where nobody knows them.
        """
        nodes, settings = self.cost_features.grid.nodes, self.settings
        if settings.truth == "unknown":
            return None
        inside = settings.touched(nodes)
        close = [level <= settings.least_distance for level in settings.features.distance_levels]
        never = [False] * (self.n_experts + len(settings.costs))  # effort, and the user's own
        return np.array([*np.tile(inside, self.n_experts), *close * len(self.pairs), *never])

    def obstacle_clearance(self, states: Array) -> Array:
        """Metres left between each drone and the nearest obstacle on each segment.

        Parameters
        ----------
        states : Array
            Shape (m, steps, N_E D).

        Returns
        -------
        Array
            Shape (m, steps - 1, N_E). Negative: it touches; infinite: there is no obstacle.
        """
        places, settings = self.positions(states), self.settings
        clearance = np.full(places[:, 1:, :, 0].shape, np.inf)
        for barrier in settings.barriers:
            left = barrier.clearance(places[:, :-1], places[:, 1:]) - settings.drone_radius
            clearance = np.minimum(clearance, left)
        return clearance

    def separation_clearance(self, states: Array) -> Array:
        """Metres by which the drones are further apart than they must be on each segment, shape (m, steps - 1)."""
        places = np.moveaxis(self.positions(states), -2, 0)
        clearance = np.full((*places.shape[1:2], places.shape[2] - 1), np.inf)
        for i, j in self.pairs:
            starts, ends = (places[i][:, :-1], places[j][:, :-1]), (places[i][:, 1:], places[j][:, 1:])
            clearance = np.minimum(clearance, swept_separation(starts, ends) - self.settings.least_distance)
        return clearance

    def violates(self, trajectories: Trajectories) -> Mask:
        """Which trajectories break a constraint, shape (m,)."""
        touching = (self.obstacle_clearance(trajectories.states) < 0).any(axis=(1, 2))
        return np.asarray(touching | (self.separation_clearance(trajectories.states) < 0).any(axis=1))

    def succeeds(self, trajectories: Trajectories) -> Mask:
        """Which trajectories break no constraint and end with every drone in its goal region, shape (m,)."""
        return np.asarray(self.arrived(trajectories.states[:, -1]).all(axis=-1) & ~self.violates(trajectories))

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """States (T + 1, N_E D) and actions (T + 1, 2 N_E), as they are."""
        return trajectory.states[0].astype(np.float64), trajectory.actions[0].astype(np.float64)

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``.

        Raises
        ------
        ImpossibleTrajectoryError
            The message names the first step that cannot be.
        """
        steps = self.horizon + 1
        for name, values, size in (("states", states, self.state_size), ("actions", actions, self.action_size)):
            if values.shape != (steps, size):
                raise ImpossibleTrajectoryError(f"{name}: shape {values.shape}, expected {(steps, size)}")
            if not np.isfinite(values).all():
                raise ImpossibleTrajectoryError(f"{name}: expected finite numbers")
        self._check_places(states)
        self._check_lengths("action", self.controls(actions), self.dynamics.max_action, self.dynamics.action_unit)
        if self.dynamics.drone_size == 4:
            self._check_lengths("velocity", self.drones(states)[..., 2:], self.dynamics.max_speed, "m/s")
        self._check_transitions(states, actions)
        return Trajectories(states[None].astype(np.float64), actions[None].astype(np.float64))

    def _check_places(self, states: Array) -> None:
        places = self.positions(states)
        outside = np.argwhere((places < -TOLERANCE) | (places > self.arena + TOLERANCE))
        if len(outside):
            step, drone, _ = outside[0]
            raise ImpossibleTrajectoryError(
                f"step {step}: drone {drone + 1} is at {_pair(places[step, drone])}, outside the arena"
                f" {self.settings.arena} [m]"
            )

    def _check_lengths(self, what: str, vectors: Array, longest: float, unit: str) -> None:
        """``vectors``: (T + 1, N_E, 2)."""
        with np.errstate(over="ignore"):  # past the range of numbers is too long as well
            too_long = np.argwhere(np.hypot(vectors[..., 0], vectors[..., 1]) > longest + TOLERANCE)
        if len(too_long):
            step, drone = too_long[0]
            raise ImpossibleTrajectoryError(
                f"step {step}: {what} {_pair(vectors[step, drone])} of drone {drone + 1} is longer than"
                f" {longest:g} {unit}"
            )

    def _check_transitions(self, states: Array, actions: Array) -> None:
        expected, given = self.drones(self.step(states[:-1], actions[:-1])), self.drones(states[1:])
        wrong = np.argwhere(np.abs(given - expected).max(axis=-1) > TOLERANCE)
        if len(wrong):
            step, drone = wrong[0]
            raise ImpossibleTrajectoryError(
                f"step {step}: drone {drone + 1} with action {_pair(self.controls(actions)[step, drone])} is then"
                f" at {_pair(given[step, drone])}; the game allows only {_pair(expected[step, drone])}"
            )


def _pair(values: Array) -> tuple[float, ...]:
    return tuple(round(float(x), 6) for x in values)
