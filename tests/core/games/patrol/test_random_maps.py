"""Random patrols: what they promise, for many seeds."""

from collections import Counter, deque

import numpy as np
import pytest

from mabirds_core.games.patrol import random_maps
from mabirds_core.games.patrol.random_maps import BUILDERS, STEP_COSTS, random_patrol
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.registry import require

SEEDS = range(150)


@pytest.fixture(scope="module")
def patrols() -> list[PatrolSettings]:
    return [random_patrol(np.random.default_rng(seed)) for seed in SEEDS]


def steps_from(rows: list[str], cell: tuple[int, int]) -> dict[tuple[int, int], int]:
    """Steps over free cells, breadth first."""
    steps, queue = {cell: 0}, deque([cell])
    while queue:
        row, column = queue.popleft()
        for there in ((row - 1, column), (row, column + 1), (row + 1, column), (row, column - 1)):
            inside = 0 <= there[0] < len(rows) and 0 <= there[1] < len(rows[0])
            if inside and rows[there[0]][there[1]] == "." and there not in steps:
                steps[there] = steps[row, column] + 1
                queue.append(there)
    return steps


def test_free_cells_are_connected_and_tasks_lie_on_them(patrols: list[PatrolSettings]) -> None:
    for patrol in patrols:
        free = {(r, c) for r, row in enumerate(patrol.rows) for c, cell in enumerate(row) if cell == "."}
        assert set(steps_from(patrol.rows, patrol.goals[0])) == free
        assert len(set(patrol.goals)) == patrol.n_experts
        assert set(patrol.goals) <= free
        for start in patrol.starts:
            assert len(set(start)) == patrol.n_experts
            assert set(start) <= free
        assert len(set(patrol.starts)) == len(patrol.starts)


def test_starts_are_three_steps_away_and_there_is_time(patrols: list[PatrolSettings]) -> None:
    for patrol in patrols:
        by_goal = [steps_from(patrol.rows, goal) for goal in patrol.goals]
        ways = [steps[cell] for start in patrol.starts for cell, steps in zip(start, by_goal, strict=True)]
        assert min(ways) >= 3
        assert patrol.deadline is not None
        assert max(ways) + 3 <= patrol.deadline < patrol.horizon
        assert patrol.step_cost in STEP_COSTS


def test_sizes_and_numbers_of_experts_and_starts(patrols: list[PatrolSettings]) -> None:
    experts = Counter(patrol.n_experts for patrol in patrols)
    assert set(experts) == {2, 3}
    assert 3 <= experts[3] <= 35
    assert {len(patrol.starts) for patrol in patrols} == {1, 2, 3, 4, 5, 6}
    for patrol in patrols:
        sides = {len(patrol.rows), len(patrol.rows[0])}
        assert sides <= ({4} if patrol.n_experts == 3 else {6, 7, 8, 9})


def test_a_seed_makes_one_patrol(patrols: list[PatrolSettings]) -> None:
    assert [random_patrol(np.random.default_rng(seed)) for seed in range(20)] == patrols[:20]
    assert len({patrol.map for patrol in patrols}) > 140


def test_the_kind_draws_the_same(patrols: list[PatrolSettings]) -> None:
    sample = require("mabirds.games", "patrol").sample
    assert sample is not None
    assert sample(np.random.default_rng(0)) == patrols[0]


@pytest.mark.parametrize("name", BUILDERS)
def test_every_builder_is_drawn_and_bounds_its_map(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = Counter[str]()

    def counted(rng: np.random.Generator, height: int, width: int) -> random_maps.Walls:
        calls[name] += 1
        walls = BUILDERS[name](rng, height, width)
        assert walls[[0, -1]].all()
        assert walls[:, [0, -1]].all()
        return walls

    monkeypatch.setattr(random_maps, "BUILDERS", {**BUILDERS, name: counted})
    for seed in range(20):
        random_patrol(np.random.default_rng(seed))
    assert calls[name] > 0
