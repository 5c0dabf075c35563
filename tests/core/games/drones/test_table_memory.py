"""Memory of tables: whoever asks next gets what nobody holds any more, and nobody gets what somebody holds."""

import numpy as np
import pytest
from arenas import arena

from mabirds_core.games.drones import table_memory
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.table_memory import TableMemory


@pytest.fixture(autouse=True)
def nothing_spare(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(table_memory, "_spare", [])


def test_what_nobody_holds_serves_again() -> None:
    first, held = TableMemory(1000), TableMemory(1000)
    arrays = first.array, held.array
    del first
    again, other = TableMemory(900), TableMemory(900)
    assert again.array is arrays[0]
    assert not any(np.shares_memory(other.array, array) for array in arrays)


def test_what_is_too_small_does_not_serve() -> None:
    first = TableMemory(10)
    del first
    assert len(TableMemory(10_000).array) >= 10_000


def test_a_policy_that_is_held_keeps_its_values() -> None:
    model = LinearDroneReward(arena(2))
    planner, states = LatticePlanner(model.game, model, 0.2), model.game.starts(5, np.random.default_rng(0))
    rng = np.random.default_rng(1)
    parameters = [(rng.normal(size=model.size), -rng.random(len(model.game.cost_features.names))) for _ in range(3)]
    held = planner.plan(*parameters[0])
    before = held.values(0, states)
    used = planner.plan(*parameters[1]).memory.array
    assert planner.plan(*parameters[2]).memory.array is used
    np.testing.assert_array_equal(held.values(0, states), before)
