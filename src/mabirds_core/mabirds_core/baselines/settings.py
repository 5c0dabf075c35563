"""Central methods as written in an experiment file. All take the algorithm's step sizes where they name none."""

from collections.abc import Mapping
from typing import ClassVar

from pydantic import Field

from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.settings import Settings


class BicsSettings(Settings):
    """BICS takes the settings of the algorithm."""


class FtlSettings(Settings):
    """Follow the leader."""

    steps: PaperSteps | None = Field(None, description="the paper's steps; default: the algorithm's rule")
    tolerance: float = Field(0.3, gt=0, description="largest entry of a gradient that counts as stationary")
    max_steps: int = Field(50, ge=1, le=100_000, description="gradient steps per iteration")

    renamed: ClassVar[Mapping[str, str]] = {"most_steps": "max_steps"}


class DlmSettings(Settings):
    """The double loop."""

    steps: PaperSteps | None = Field(None, description="the paper's steps; default: the algorithm's rule")
    tolerance: float = Field(0.5, gt=0, description="largest entry of the inner gradient that counts as solved")
    max_steps: int = Field(50, ge=1, le=100_000, description="inner steps per iteration")
    window: int = Field(10, ge=1, le=1000, description="l: iterations whose demonstrations make a loss")

    renamed: ClassVar[Mapping[str, str]] = {"most_steps": "max_steps"}


class MeGreedySettings(Settings):
    """Maximum-likelihood constraint inference with the true reward given."""

    least_mass: float = Field(0.01, gt=0, lt=1, description="probability that a new constraint must remove")


class MeGradientSettings(Settings):
    """Maximum-entropy constraint inference by gradient with the true reward given."""

    steps: PaperSteps | None = Field(None, description="the paper's steps; default: the algorithm's rule")
