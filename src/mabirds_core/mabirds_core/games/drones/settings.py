"""The drone game as written in an experiment file; metres, seconds."""

from collections.abc import Mapping
from functools import cached_property
from itertools import combinations, pairwise
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from mabirds_core.arrays import Array, Mask
from mabirds_core.games.drones.geometry import segment_distance
from mabirds_core.games.drones.named_costs import check_values
from mabirds_core.games.drones.regions import GoalRegion, Length, Obstacle, Point, inside
from mabirds_core.games.drones.space import DroneSpace
from mabirds_core.settings import Settings

MAX_FEATURES = 100_000
"""Cost features of a game; a million of them would fill a message with megabytes."""

Spread = Annotated[float, Field(ge=0, le=1000)]


class DroneTask(Settings):
    """Where one drone begins and where it is to go."""

    start: Point = Field(description="middle of the square in which it begins [m]")
    start_spread: Spread | tuple[Spread, Spread] = Field(
        0.0, description="half the side of that square, or of a rectangle along x and along y [m]"
    )
    goal_region: GoalRegion

    renamed: ClassVar[Mapping[str, str]] = {"door": "goal_region"}

    @property
    def start_corners(self) -> tuple[Array, Array]:
        """Lower left and upper right corner of where it begins, shape (2,) each [m]."""
        half = np.broadcast_to(self.start_spread, 2)
        return np.subtract(self.start, half), np.add(self.start, half)


class DroneFeatureSettings(Settings):
    """What costs and linear rewards are made of.

    Gaussian radial basis functions (RBFs) exp(-d^2 / 2 width^2) of places, and steps 1 / (1 + exp((d - level) /
    softness)) of two drones' distance d, which say "nearer than this" and nothing else.
    """

    cost_spacing: Length = Field(0.375, description="between the cost features' RBFs [m]")
    cost_width: Length = Field(0.2, description="of the cost features' RBFs [m]")
    distance_levels: tuple[Length, ...] = Field(
        (0.35, 0.45, 0.6, 0.9), description="below which the steps of two drones' distance are 1 [m]"
    )
    distance_softness: Length = Field(0.03, description="over which those steps fall [m]")
    distance_scale: float = Field(1.0, gt=0, le=1000, description="how often those count: drones seldom meet")
    effort_scale: float = Field(0.1, ge=0, le=1000, description="of the feature (|action| / largest action)^2")
    reward_spacing: Length = Field(0.5, description="between the linear reward's RBFs [m]")
    reward_width: Length = Field(0.4, description="of the linear reward's RBFs [m]")


class DroneSettings(Settings):
    """An arena with obstacles and goal regions, and the drones that cross it; see ros_ws/config/drones.yaml."""

    kind: Literal["drones"]
    arena: tuple[Length, Length] = Field(description="width and depth [m]; walls stop drones")
    obstacles: tuple[Obstacle, ...] = Field((), max_length=1000, description="what drones may not touch")
    walls: tuple[tuple[Point, ...], ...] = Field(
        (),
        max_length=1000,
        description="corners of walls, which may not be touched; a closed one may not be entered [m]",
    )
    wall_radius: Length = Field(0.01, description="half the thickness of walls [m]")
    drones: tuple[DroneTask, ...] = Field(min_length=1, max_length=10)
    dynamics: Literal["single_integrator", "double_integrator"] = Field(
        "single_integrator", description="actions are velocities, or accelerations"
    )
    time_step: float = Field(0.25, gt=0, le=60, description="between two steps [s]")
    horizon: int = Field(40, ge=1, le=10_000, description="T: trajectories have T + 1 steps")
    discount: float = Field(0.97, gt=0, le=1, description="gamma")
    max_speed: Length = Field(1.0, description="[m/s]")
    max_acceleration: Length = Field(2.0, description="of double integrators [m/s^2]")
    drone_radius: Length = Field(0.12, description="[m]")
    least_distance: Length = Field(0.35, description="of two drones' middles [m]")
    observation_noise: float = Field(
        0.0, ge=0, le=1000, description="how far demonstrated places may be from where drones were [m]; 0: exact"
    )
    truth: Literal["settings", "unknown"] = Field(
        "settings",
        description="do obstacles and least_distance bind the experts, or does nobody know, as of recordings?",
    )
    step_cost: float = Field(0.1, ge=0, le=1000, description="true reward: minus this per step and drone under way")
    features: DroneFeatureSettings = DroneFeatureSettings()
    costs: dict[Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")], str] = Field(
        default_factory=dict, max_length=32, description="cost features of your own: expressions by name"
    )

    renamed: ClassVar[Mapping[str, str]] = {"room": "arena", "pillars": "obstacles"}

    @property
    def n_experts(self) -> int:
        """N_E."""
        return len(self.drones)

    @cached_property
    def barriers(self) -> tuple[Obstacle, ...]:
        """Obstacles, and each straight piece of a wall."""
        pieces = (piece for wall in self.walls for piece in pairwise(wall))
        return (*self.obstacles, *(Obstacle(centre=a, until=b, radius=self.wall_radius) for a, b in pieces))

    def touched(self, places: Array) -> Mask:
        """Where, of places (..., 2) [m], a drone would touch a barrier or be behind closed walls, shape (...)."""
        touched = np.zeros(places.shape[:-1], dtype=bool)
        for barrier in self.barriers:
            touched |= barrier.away(places) < (barrier.radius + self.drone_radius) ** 2
        for wall in self.walls:
            if wall[0] == wall[-1]:
                touched |= inside(np.array(wall), places)
        return touched

    def lattice(self, spacing: float) -> tuple[int, int]:
        """Points of a lattice over the arena that is no coarser than ``spacing``, by axis."""
        return tuple(int(np.ceil(side / spacing * (1 - 1e-9))) + 1 for side in self.arena)  # type: ignore[return-value]

    @model_validator(mode="after")
    def _fits_into_the_arena(self) -> "DroneSettings":
        for number, task in enumerate(self.drones, start=1):
            ends = (task.goal_region.centre, task.goal_region.until or task.goal_region.centre)
            for name, point in (("start", task.start), *(("goal_region", end) for end in ends)):
                if not all(0 <= x <= side for x, side in zip(point, self.arena, strict=True)):
                    raise ValueError(f"{name} {point} of drone {number}: expected a place in the arena {self.arena}")
            if self.truth == "settings":
                for barrier in self.barriers:
                    self._check_free(number, task, barrier)
        return self

    def _check_free(self, number: int, task: DroneTask, barrier: Obstacle) -> None:
        """No start may touch a barrier, and the centre of no goal region."""
        keep = barrier.radius + self.drone_radius
        goal = np.array(task.goal_region.centre)
        between = {"start": _between(task.start_corners, barrier), "goal_region": float(np.sqrt(barrier.away(goal)))}
        for name, distance in between.items():
            if distance < keep:
                what = "obstacle" if barrier.until is None else f"wall to {barrier.until} that begins"
                raise ValueError(
                    f"{name} of drone {number} touches the {what} at {barrier.centre}: expected {keep:g} m between"
                    " their middles; move one of them"
                )

    @field_validator("walls")
    @classmethod
    def _have_pieces(cls, walls: tuple[tuple[Point, ...], ...]) -> tuple[tuple[Point, ...], ...]:
        for wall in walls:
            if len(wall) < 2 or any(a == b for a, b in pairwise(wall)):
                raise ValueError(f"{wall}, expected two corners or more, no two alike one after the other")
        return walls

    @model_validator(mode="after")
    def _noise_is_of_places(self) -> "DroneSettings":
        if self.observation_noise and self.dynamics != "single_integrator":
            raise ValueError(
                f"observation_noise {self.observation_noise:g}: expected 0 with dynamics {self.dynamics}, whose"
                " velocities noisy places do not tell; set dynamics to single_integrator"
            )
        return self

    @model_validator(mode="after")
    def _starts_are_apart(self) -> "DroneSettings":
        for (i, first), (j, second) in combinations(enumerate(self.drones, start=1), 2):
            (low, high), (other_low, other_high) = first.start_corners, second.start_corners
            gap = np.maximum(low - other_high, other_low - high)
            if self.truth == "settings" and np.hypot(*np.maximum(gap, 0.0)) < self.least_distance:
                raise ValueError(
                    f"drones {i} and {j} may start closer than least_distance {self.least_distance:g} m;"
                    " move their starts apart, or make start_spread smaller"
                )
        return self

    @model_validator(mode="after")
    def _costs_have_values(self) -> "DroneSettings":
        size = 2 if self.dynamics == "single_integrator" else 4
        check_values(DroneSpace(self.arena, self.n_experts, size), self.max_speed, self.costs)
        return self

    @model_validator(mode="after")
    def _features_are_few(self) -> "DroneSettings":
        spacings = {"cost_spacing": self.features.cost_spacing, "reward_spacing": self.features.reward_spacing}
        for name, spacing in spacings.items():
            count = self.n_experts * int(np.prod(np.array(self.lattice(spacing), dtype=float)))
            if count > MAX_FEATURES:
                raise ValueError(
                    f"features.{name} {spacing:g} makes {count} RBF features, expected at most {MAX_FEATURES}"
                )
        return self


def _between(corners: tuple[Array, Array], barrier: Obstacle) -> float:
    """Distance of a rectangle's places to a barrier's segment [m]; 0 where it leads through."""
    low, high = corners
    if ((low <= barrier.centre) & (barrier.centre <= high)).all():
        return 0.0
    ring = np.array([low, (high[0], low[1]), high, (low[0], high[1]), low])
    return float(segment_distance(ring[:-1], ring[1:], *map(np.array, barrier.ends)).min())
