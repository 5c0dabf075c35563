"""Planners of drones as written in an experiment file."""

from typing import Literal

from pydantic import Field

from mabirds_core.settings import Settings


class LatticeSettings(Settings):
    """Near-exact: soft value iteration on a lattice, for one or two drones that are single integrators."""

    kind: Literal["lattice"]
    spacing: float = Field(0.3, ge=1e-6, le=1000, description="largest distance of two nodes [m]")
    temperature: float = Field(1.0, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")


class SoftActorCriticSettings(Settings):
    """Networks that learn from imagined rollouts and observed demonstrations, kept from iteration to iteration."""

    kind: Literal["soft_actor_critic"]
    temperature: float = Field(0.02, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")
    hidden: int = Field(128, ge=1, le=10_000, description="units of each of the two hidden layers")
    steps: int = Field(150, ge=1, le=1_000_000, description="gradient steps per search")
    first_steps: int = Field(600, ge=1, le=1_000_000, description="gradient steps of the first search")
    batch: int = Field(128, ge=1, le=1_000_000, description="transitions per gradient step")
    capacity: int = Field(30_000, ge=1, le=10_000_000, description="transitions that are kept")
    rollouts: int = Field(32, ge=1, le=100_000, description="trajectories added to them in each search")
    learning_rate: float = Field(1e-3, gt=0, le=1, description="of the first search")
    device: Literal["cpu", "cuda"] = Field("cpu", description="what computes")
    threads: int = Field(1, ge=1, le=1024, description="of the CPU; results repeat bit for bit with one")
