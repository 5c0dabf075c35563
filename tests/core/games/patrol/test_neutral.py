"""The potential and the ordinary reward behind an expert's moves, and what makes a cell neutral."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.patrol.geometry import PatrolGrid
from mabirds_core.games.patrol.neutral import ExpertMoves

GAMMA = 0.9
GRID = PatrolGrid(3, 4, (((2, 3),),))
SUCCESSOR, GOALS, GOAL, CELLS = GRID.expert_successor[0], GRID.is_goal[0], 11, 12


def shaped(potential: Vector, rho: float, successor: Array = SUCCESSOR, discount: float = GAMMA) -> Array:
    """r(c, a) = rho + Phi(c) - gamma Phi(c'), shape (n, 4)."""
    return rho + potential[:, None] - discount * potential[successor]


def some_potential(seed: int) -> Vector:
    potential = np.random.default_rng(seed).normal(scale=3, size=CELLS)
    potential[GOAL] = 0.0
    return potential


def counts(seed: int, absent: tuple[int, ...] = ()) -> Array:
    made = np.random.default_rng(seed).uniform(0.02, 2, size=(CELLS, 4))
    made[list(absent)] = 0.0
    return made


@given(st.integers(0, 10**6), st.floats(-5, 5))
def test_potential_and_ordinary_reward_are_recovered(seed: int, rho: float) -> None:
    potential = some_potential(seed)
    moves = ExpertMoves(SUCCESSOR, GOALS, shaped(potential, rho), counts(seed), GAMMA)
    recovered, ordinary = moves.ordinary()
    np.testing.assert_allclose(recovered, potential, rtol=0, atol=1e-9)
    assert ordinary == pytest.approx(rho, abs=1e-9)


def test_moves_at_the_goal_say_nothing() -> None:
    potential, made = some_potential(1), counts(1)
    rewards = shaped(potential, -1.0)
    rewards[GOAL] = 100.0
    recovered, ordinary = ExpertMoves(SUCCESSOR, GOALS, rewards, made, GAMMA).ordinary()
    np.testing.assert_allclose(recovered, potential, rtol=0, atol=1e-9)
    assert ordinary == pytest.approx(-1, abs=1e-9)


def test_least_squares_are_weighed_by_how_often_a_move_is_made() -> None:
    """Against the normal equations, for rewards that no potential explains."""
    rng, made = np.random.default_rng(2), counts(2)
    rewards = rng.normal(size=(CELLS, 4))
    recovered, ordinary = ExpertMoves(SUCCESSOR, GOALS, rewards, made, GAMMA).ordinary()
    misses = rewards - shaped(recovered, ordinary)
    weighed = made * misses
    weighed[GOAL] = 0.0
    assert weighed.sum() == pytest.approx(0, abs=1e-9)
    for cell in set(range(CELLS)) - {GOAL}:
        balance = weighed[cell].sum() - GAMMA * weighed[cell == SUCCESSOR].sum()
        assert balance == pytest.approx(0, abs=1e-9)


@given(st.integers(0, 10**6), st.floats(-5, 5))
def test_a_constant_adds_to_the_ordinary_reward_alone(seed: int, constant: float) -> None:
    """Also where few moves are made, so that many potentials explain them equally well."""
    rng = np.random.default_rng(seed)
    made = counts(seed) * (rng.random((CELLS, 4)) < 0.15)
    made[0, 1] = 1.0
    rewards = rng.normal(size=(CELLS, 4))
    before, after = (ExpertMoves(SUCCESSOR, GOALS, rewards + c, made, GAMMA).ordinary() for c in (0.0, constant))
    np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-9)
    assert after[1] == pytest.approx(before[1] + constant, abs=1e-9)


@pytest.mark.parametrize("cell", [1, 5, 6])
def test_neutral_moves_are_worth_an_ordinary_move(cell: int) -> None:
    """A cell that costs 40 and is not visited: r less the potential, the moves into and out of it come to rho."""
    potential, rho = some_potential(3), -0.5
    rewards = shaped(potential, rho)
    rewards[cell] -= 40.0
    moves = ExpertMoves(SUCCESSOR, GOALS, rewards, counts(3, absent=(cell,)), GAMMA)
    entries = {(c, a) for c in range(CELLS) for a in range(4) if SUCCESSOR[c, a] == cell and c not in {cell, GOAL}}
    assert set(moves.neighbours(cell)) == entries
    change = moves.neutral_change(cell)
    assert change is not None
    own = moves.ordinary()[0]
    own[cell] = np.mean([own[c] for c, _ in entries])
    canonical = (rewards + change) - (own[:, None] - GAMMA * own[SUCCESSOR])
    leaving = [(cell, a) for a in range(4)]
    for c, a in [*entries, *leaving]:
        assert canonical[c, a] == pytest.approx(moves.ordinary()[1], abs=1e-9)
    changed = {(int(c), int(a)) for c, a in np.argwhere(change)}
    assert changed <= entries | set(leaving)


def test_a_cell_like_its_neighbours_needs_no_change() -> None:
    potential = np.zeros(CELLS)
    moves = ExpertMoves(SUCCESSOR, GOALS, shaped(potential, -1.0), counts(4), GAMMA)
    change = moves.neutral_change(5)
    assert change is not None
    np.testing.assert_allclose(change, 0, atol=1e-9)


def test_a_cell_that_no_way_passes_beside_has_no_neutral_change() -> None:
    """Ways along the upper row: the cells below it lie beside them, the goal's row does not."""
    made = counts(5)
    made[4:] = 0.0
    moves = ExpertMoves(SUCCESSOR, GOALS, shaped(some_potential(5), -1.0), made, GAMMA)
    assert [cell for cell in range(CELLS) if moves.neutral_change(cell) is None] == [8, 9, 10, 11]


def test_the_goal_is_no_neighbour() -> None:
    """Who has arrived goes nowhere, though the cell is visited."""
    made = np.zeros((CELLS, 4))
    made[GOAL] = 1.0
    moves = ExpertMoves(SUCCESSOR, GOALS, shaped(some_potential(6), -1.0), made, GAMMA)
    assert moves.visited[GOAL]
    assert all(moves.neutral_change(cell) is None for cell in range(CELLS))
