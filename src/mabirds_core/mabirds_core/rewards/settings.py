"""Reward models as written in an experiment file."""

from typing import Literal

from pydantic import Field

from mabirds_core.settings import Settings


class LinearRewardSettings(Settings):
    """r_theta = theta^T f."""

    kind: Literal["linear"] = "linear"
    lateness: bool = Field(
        True,
        description="a parameter of its own for coming too late, in games that have one; false: as the paper has it",
    )


class NeuralRewardSettings(Settings):
    """r_theta of a small network, |r_theta| <= bound."""

    kind: Literal["neural"]
    hidden: int = Field(32, ge=1, le=10_000, description="units of the hidden layer")
    bound: float = Field(10.0, gt=0, le=1000, description="C: no reward is larger in absolute value")
    lateness: bool = Field(
        True,
        description="a parameter of its own for coming too late beside networks, in games that have one",
    )
