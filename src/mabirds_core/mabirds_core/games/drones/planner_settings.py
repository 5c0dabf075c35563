"""Planners of drones as written in an experiment file."""

from typing import Literal

from pydantic import Field

from mabirds_core.settings import Settings


class LatticeSettings(Settings):
    """Exact for flights from node to node of a lattice, by one or two drones that are single integrators.

    The longest move should be what a drone flies in a step, or it is slower than it might be: with a hexagonal lattice,
    spacings of that way divided by 1, sqrt(3), 2 or sqrt(7); with a square one, by 1, sqrt(2), 2 or sqrt(5).
    """

    kind: Literal["lattice"]
    spacing: float | None = Field(
        None, ge=1e-6, le=1000, description="of neighbouring nodes [m]; default: time_step * max_speed / sqrt(3)"
    )
    shape: Literal["hexagonal", "square"] = Field("hexagonal", description="of the lattice")
    rotations: int = Field(8, ge=1, le=1000, description="lattices, rotated and shifted, of which each iteration draws")
    temperature: float = Field(1.0, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")


class SoftActorCriticSettings(Settings):
    """Continuous actions: by values of single integrators and their pairs; else by networks that learn from rollouts.

    Networks learn from imagined rollouts and observed demonstrations and are kept from iteration to iteration. All but
    ``temperature`` and ``guide`` is theirs.
    """

    kind: Literal["soft_actor_critic"]
    temperature: float = Field(0.02, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")
    hidden: int = Field(128, ge=1, le=10_000, description="units of each of the two hidden layers")
    steps: int = Field(150, ge=1, le=1_000_000, description="gradient steps per search")
    first_steps: int = Field(600, ge=1, le=1_000_000, description="gradient steps of the first search")
    batch: int = Field(128, ge=1, le=1_000_000, description="transitions per gradient step")
    capacity: int = Field(30_000, ge=1, le=10_000_000, description="transitions that are kept")
    rollouts: int = Field(32, ge=1, le=100_000, description="trajectories added to them in each search")
    learning_rate: float = Field(1e-3, gt=0, le=1, description="of the first search")
    guide: Literal["lattice", "none"] | None = Field(
        None, description="values by drone and by pair in place of networks; default: lattice, for single integrators"
    )
    device: Literal["cpu", "cuda"] = Field("cpu", description="what computes")
    threads: int = Field(1, ge=1, le=1024, description="of the CPU; results repeat bit for bit with one")
