"""Drawing cells of several drones: with the density that is said, and exactly by their couplings for three."""

from itertools import combinations

import numpy as np
import pytest

from mabirds_core.arrays import Array
from mabirds_core.games.drones.joint_cells import drawn_cells
from mabirds_core.games.drones.lone_fields import Float

K, M = 3, 60_000


def coupled(drones: int, strength: float = 2.0) -> tuple[list[Float], dict[tuple[int, int], Float]]:
    """Scores of one joint state and couplings."""
    rng = np.random.default_rng(drones)
    scores = [rng.normal(size=(1, K)).astype(np.float32) for _ in range(drones)]
    pairs = combinations(range(drones), 2)
    return scores, {pair: (strength * rng.normal(size=(1, K, K))).astype(np.float32) for pair in pairs}


def repeated(values: Float) -> Float:
    return np.repeat(values, M, axis=0)


def exact(scores: list[Float], couplings: dict[tuple[int, int], Float]) -> Array:
    """log pi of all joint cells, each drone's along an axis."""
    cells = np.indices((K,) * len(scores))
    total = sum((of[0, cells[i]] for i, of in enumerate(scores)), np.zeros(cells.shape[1:]))
    for (i, j), of in couplings.items():
        total = total + of[0, cells[i], cells[j]]
    return np.asarray(total - np.log(np.exp(total).sum()))


def draw(scores: list[Float], couplings: dict[tuple[int, int], Float]) -> tuple[tuple[Array, ...], Array]:
    rng = np.random.default_rng(1)
    uniform = [rng.random((M, 1)) for _ in range(max(2, len(scores)))]
    cells, log_pi = drawn_cells(
        [repeated(of) for of in scores], {pair: repeated(of) for pair, of in couplings.items()}, uniform
    )
    return tuple(cells), log_pi


@pytest.mark.parametrize("drones", [1, 2, 3])
def test_up_to_three_drones_are_drawn_exactly(drones: int) -> None:
    scores, couplings = coupled(drones)
    cells, log_pi = draw(scores, couplings)
    expected = exact(scores, couplings)
    assert log_pi == pytest.approx(expected[cells], abs=1e-4)
    counts = np.zeros(expected.shape)
    np.add.at(counts, cells, 1 / M)
    assert np.abs(counts - np.exp(expected)).max() < 0.01


def test_of_four_the_density_is_that_of_what_is_drawn() -> None:
    scores, couplings = coupled(4, 1.0)
    cells, log_pi = draw(scores, couplings)
    counts, said = np.zeros((K,) * 4), np.zeros((K,) * 4)
    np.add.at(counts, cells, 1 / M)
    said[cells] = np.exp(log_pi)
    assert np.abs(counts - said).max() < 0.01
    assert said.sum() == pytest.approx(1, abs=0.01)
    assert 0.01 < np.abs(said - np.exp(exact(scores, couplings))).sum() / 2 < 0.1  # what is left out


def test_who_does_not_matter_to_others_is_drawn_alone() -> None:
    scores, _ = coupled(4)
    cells, log_pi = draw(scores, {})
    assert log_pi == pytest.approx(exact(scores, {})[cells], abs=1e-4)


def test_what_is_as_good_as_forbidden_is_not_drawn() -> None:
    """Drones 1 and 2 leave to drone 3 the only cell that it wants."""
    scores = [np.zeros((1, K), np.float32), np.zeros((1, K), np.float32), np.array([[0, -300, -300]], np.float32)]
    apart = -150 * np.eye(K, dtype=np.float32)[None]
    (first, second, third), log_pi = draw(scores, {(0, 1): apart, (0, 2): apart, (1, 2): apart})
    assert (third == 0).all()
    assert min(first.min(), second.min()) > 0
    assert (first != second).all()
    assert log_pi == pytest.approx(np.log(1 / 2), abs=1e-4)
