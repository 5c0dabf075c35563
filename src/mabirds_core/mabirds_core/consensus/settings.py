"""Settings of how learners mix what they know: strictly, or so that the network survives loss."""

from typing import Literal

from pydantic import Field

from mabirds_core.settings import Settings


class StrictMixing(Settings):
    """The paper's iteration: every scheduled neighbour is waited for, however long."""

    kind: Literal["strict"] = "strict"


class ResilientMixing(Settings):
    """Push-sum with running sums: a neighbour that is late is not waited for, and what it gave arrives later."""

    kind: Literal["resilient"]
    patience: float = Field(1.0, gt=0, le=3600, description="seconds for which late neighbours are waited for")
    smallest_weight: float = Field(0.1, gt=0, lt=1, description="a learner with less keeps its mass and its estimate")


MixingSettings = StrictMixing | ResilientMixing
