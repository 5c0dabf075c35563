"""Memory of tables: whoever asks next gets what nobody holds any more, and nobody gets what somebody holds."""

import numpy as np
import pytest
from arenas import arena

from mabirds_core.games.drones import table_memory as spare
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.table_memory import table_memory


@pytest.fixture(autouse=True)
def nothing_spare(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spare, "_spare", [])


def address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def test_what_nobody_holds_serves_again() -> None:
    first, held = table_memory(1000), table_memory(1000)
    place = address(first)
    del first
    again, other = table_memory(900), table_memory(900)
    assert address(again) == place
    assert not any(np.shares_memory(other, array) for array in (again, held))


def test_whoever_holds_a_part_holds_it_all() -> None:
    part = table_memory(1000)[10:20].reshape(2, 5)
    part[:] = 7
    table_memory(1000)[:] = 0
    assert (part == 7).all()


def test_what_is_too_small_is_given_back() -> None:
    table_memory(10)
    assert len(spare._spare) == 1
    assert len(table_memory(10_000)) >= 10_000
    assert len(spare._spare) == 1
    assert len(spare._spare[0]) >= 10_000


def test_few_wait_for_somebody() -> None:
    held = [table_memory(10) for _ in range(2 * spare.MOST_SPARE)]
    del held
    assert len(spare._spare) == spare.MOST_SPARE


def test_a_policy_that_is_held_keeps_its_values() -> None:
    model = LinearDroneReward(arena(2))
    planner, states = LatticePlanner(model.game, model, 0.2), model.game.starts(5, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    parameters = [(rng.normal(size=model.size), -rng.random(len(model.game.cost_features.names))) for _ in range(3)]
    held = planner.plan(*parameters[0])
    before = held.values(0, states)
    used = address(planner.plan(*parameters[1]).memory)
    assert address(planner.plan(*parameters[2]).memory) == used
    np.testing.assert_array_equal(held.values(0, states), before)
