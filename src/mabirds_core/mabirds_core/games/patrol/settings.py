"""The patrol game as written in an experiment file."""

from itertools import chain
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, field_validator, model_validator

from mabirds_core.expressions import Expression
from mabirds_core.games.patrol.geometry import Cell, PatrolGrid
from mabirds_core.games.patrol.named_costs import FEATURES, QUANTITIES, named_features, quantity_names
from mabirds_core.registry import text_or_union
from mabirds_core.settings import Settings

MAX_PAIRS = 20_000_000
"""Joint state-action pairs that a learner can tabulate: some gigabytes."""
MAX_FLOAT = 10**300
"""Larger whole numbers cannot be written as floating-point ones."""
MAX_VALUES = 200_000_000
"""Values of joint states at all steps that a policy can keep: 1.6 gigabytes."""


if TYPE_CHECKING:
    CostFeature: TypeAlias = Any
else:
    CostFeature = text_or_union(FEATURES)

MAX_COSTS = 32
"""Cost features of the user's own."""

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]


class PatrolSettings(Settings):
    """Experts who walk on a grid map to their goals, past obstacles and each other.

    >>> PatrolSettings(map="...", starts=[[(0, 0), (0, 2)]], goals=[(0, 2), (0, 0)], horizon=4).n_experts
    2
    """

    kind: Literal["patrol"] = "patrol"
    map: str = Field(description="rows of '.' (free) and '#' (obstacle), all of one length")
    starts: tuple[tuple[Cell, ...], ...] = Field(min_length=1, description="joint starts: one cell per expert")
    start_probabilities: tuple[float, ...] | None = Field(None, description="of the joint starts; default: uniform")
    goals: tuple[Cell | tuple[Cell, ...], ...] = Field(
        min_length=1, description="per expert an absorbing goal: a cell, or a list of cells, any of which will do"
    )
    horizon: int = Field(ge=1, le=10_000, description="T: trajectories have T + 1 steps")
    discount: float = Field(0.95, gt=0, le=1, description="gamma")
    joint_scale: float = Field(1.0, gt=0, le=1000, description="of the features for sharing and swapping cells")
    step_cost: float = Field(1.0, ge=0, le=1000, description="true reward: minus this per step and expert under way")
    deadline: int | None = Field(None, ge=0, description="step by which experts arrive; default: the horizon")
    waiting: bool = Field(default=False, description="experts may stay where they are")
    diagonals: bool = Field(
        default=False, description="experts may also move northeast, southeast, southwest, northwest"
    )
    leaving: bool = Field(
        default=False,
        description="goals are exits: who has arrived is gone and in nobody's way; demonstrations may end early",
    )
    slip: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="chance that an expert makes any of its moves, all equally likely, for the one it chose",
    )
    violation_cost: float = Field(
        20.0, gt=0, le=1000, description="where experts slip: what a step with a violation, or too late, costs them"
    )
    truth: Literal["map", "unknown"] = Field(
        "map", description="map: obstacles, sharing and swapping are forbidden; unknown: nobody can say what is"
    )

    cell: float | None = Field(None, gt=0, le=1000, description="side of a cell, of recordings [m]")
    time_step: float | None = Field(None, gt=0, le=86_400, description="of a step, of recordings [s]")
    true_cost: str | None = Field(
        None, description="what a step costs experts beside step_cost and constraints: an expression, as those of costs"
    )
    costs: dict[Name, CostFeature] = Field(
        default_factory=dict,
        max_length=MAX_COSTS,
        description="cost features of your own by name: expressions, or kinds",
    )
    layers: dict[Name, tuple[tuple[float, ...], ...]] = Field(
        default_factory=dict, max_length=MAX_COSTS, description="numbers of the map's cells, row by row, for costs"
    )

    @field_validator("map")
    @classmethod
    def _map_is_a_rectangle(cls, text: str) -> str:
        rows = text.split()
        if not rows or any(len(row) != len(rows[0]) for row in rows) or set("".join(rows)) - set(".#"):
            raise ValueError("expected rows of '.' and '#' of one length")
        return "\n".join(rows)

    @model_validator(mode="after")
    def _deadline_is_a_step(self) -> "PatrolSettings":
        if self.deadline is not None and self.deadline > self.horizon:
            raise ValueError(f"deadline {self.deadline}: expected a step up to the horizon, {self.horizon}")
        return self

    @model_validator(mode="after")
    def _cells_fit(self) -> "PatrolSettings":
        rows = self.rows
        for cell in (*chain(*self.goal_cells), *chain(*self.starts)):
            _check_free(rows, cell)
        self._check_goals()
        for start in self.starts:
            if len(start) != self.n_experts or len(set(start)) != self.n_experts:
                raise ValueError(f"start {start}: expected {self.n_experts} different cells, one per expert")
        self._check_probabilities()
        self._check_size()
        return self

    def _check_goals(self) -> None:
        if not all(self.goal_cells):
            raise ValueError(f"goals {self.goals}: expected at least one cell for each expert")
        every = [*chain(*map(set, self.goal_cells))]
        if not self.leaving and len(set(every)) != len(every):
            raise ValueError(
                f"goals {self.goals}: expected a different goal for each expert; exits can be shared (leaving: true)"
            )

    @model_validator(mode="after")
    def _nobody_knows_the_obstacles(self) -> "PatrolSettings":
        if self.truth == "unknown" and "#" in self.map:
            raise ValueError("truth unknown: expected a map without '#'; leave truth out where obstacles are known")
        if self.truth == "unknown" and self.true_cost is not None:
            raise ValueError("truth unknown: expected no true_cost; leave truth out where it is known")
        return self

    @model_validator(mode="after")
    def _costs_have_values(self) -> "PatrolSettings":
        shape = [len(self.rows[0])] * len(self.rows)
        for name, layer in self.layers.items():
            if name in QUANTITIES:
                raise ValueError(f"layers.{name}: expected another name than {', '.join(QUANTITIES)}, which are taken")
            if [len(row) for row in layer] != shape:
                raise ValueError(f"layers.{name}: expected {len(shape)} rows of {shape[0]} numbers, as the map has")
        names = quantity_names(self.n_experts, self.layers)
        for name, cost in self._every_cost.items():
            if isinstance(cost, str) and (unknown := Expression(cost).names - names):
                raise ValueError(f"{name}: {sorted(unknown)} is none of {sorted(names)}")
        named_features(self.grid, self._every_cost, self.layers)
        return self

    @property
    def _every_cost(self) -> dict[str, Any]:
        """By the place where they stand."""
        costs = {f"costs.{name}": cost for name, cost in self.costs.items()}
        return costs if self.true_cost is None else {**costs, "true_cost": self.true_cost}

    def _check_size(self) -> None:
        grid = self.grid
        states = grid.n_states
        pairs, values = states * grid.n_actions, states * (self.horizon + 2)
        experts = f"{self.n_experts} experts on a {grid.height}x{grid.width} map make"
        if pairs > MAX_PAIRS:
            raise ValueError(
                f"{experts} {min(pairs, MAX_FLOAT):.2g} joint state-action pairs, expected at most {MAX_PAIRS:.2g};"
                " take a smaller map or fewer experts"
            )
        if values > MAX_VALUES:
            raise ValueError(
                f"{experts} {states} joint states, {values:.2g} values in {self.horizon + 2} steps, expected at most"
                f" {MAX_VALUES:.2g}; take a shorter horizon, a smaller map or fewer experts"
            )

    def _check_probabilities(self) -> None:
        given = self.start_probabilities
        if given is not None and (
            len(given) != len(self.starts) or min(given) < 0 or not np.isclose(sum(given), 1, rtol=0, atol=1e-9)
        ):
            raise ValueError(f"start_probabilities {given}: expected {len(self.starts)} numbers >= 0 with sum 1")

    @property
    def rows(self) -> list[str]:
        """The map's rows from top to bottom."""
        return self.map.split("\n")

    @property
    def n_experts(self) -> int:
        """N_E."""
        return len(self.goals)

    @property
    def goal_cells(self) -> tuple[tuple[Cell, ...], ...]:
        """The cells of each expert's goal."""
        return tuple(_as_cells(goal) for goal in self.goals)

    @property
    def grid(self) -> PatrolGrid:
        """Where experts can be and go."""
        return PatrolGrid(
            len(self.rows), len(self.rows[0]), self.goal_cells, self.waiting, self.diagonals, self.leaving, self.slip
        )


def _as_cells(goal: Cell | tuple[Cell, ...]) -> tuple[Cell, ...]:
    """A single cell is the list of it alone."""
    if goal and isinstance(goal[0], int):
        return (goal,)
    return goal


def _check_free(rows: list[str], cell: Cell) -> None:
    inside = 0 <= cell[0] < len(rows) and 0 <= cell[1] < len(rows[0])
    if not inside or rows[cell[0]][cell[1]] != ".":
        raise ValueError(f"cell {cell} as (row, column): expected a free cell of the {len(rows)}x{len(rows[0])} map")
