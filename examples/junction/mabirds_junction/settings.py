"""The junction as written in an experiment file."""

from typing import Literal

from pydantic import Field, model_validator

from mabirds_core.settings import Settings

MAX_PAIRS = 2_000_000
"""Joint state-action pairs that a learner can tabulate in a second."""


class JunctionSettings(Settings):
    """Lanes that cross in one place. A lane has cells 0, 1, ...; a vehicle leaves at its last one."""

    kind: Literal["junction"]
    lengths: tuple[int, ...] = Field(min_length=1, max_length=4, description="cells of each vehicle's lane")
    crossings: tuple[int, ...] = Field(description="which cell of each lane is the junction")
    starts: tuple[tuple[int, ...], ...] = Field(min_length=1, description="joint starts: one cell per vehicle")
    horizon: int = Field(ge=1, le=1000, description="T: trajectories have T + 1 steps")
    discount: float = Field(0.95, gt=0, le=1, description="gamma")
    step_cost: float = Field(1.0, ge=0, le=1000, description="true reward: minus this per step for each vehicle")

    @model_validator(mode="after")
    def _cells_fit(self) -> "JunctionSettings":
        vehicles, pairs = len(self.lengths), 2 ** len(self.lengths)
        for cells in (self.crossings, *self.starts):
            if len(cells) != vehicles or not all(0 <= c < n for c, n in zip(cells, self.lengths, strict=True)):
                raise ValueError(f"cells {cells}: expected one cell of each lane, which have {self.lengths} cells")
        for length in self.lengths:
            pairs *= length
        if pairs > MAX_PAIRS:
            raise ValueError(f"{pairs} joint state-action pairs, expected at most {MAX_PAIRS}; take shorter lanes")
        return self
