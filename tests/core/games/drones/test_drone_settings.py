"""Settings of the drone game: what makes a game, what is refused with which words, digests."""

from typing import Any

import numpy as np
import pytest
from arenas import arena, arena_settings
from pydantic import ValidationError


def test_the_digest_is_of_what_decides_trajectories_alone() -> None:
    assert arena(2).digest == arena(2).digest
    deciding: list[dict[str, Any]] = [
        {"horizon": 4},
        {"time_step": 0.26},
        {"arena": (1.6, 1.3)},
        {"drones.1.goal_region.radius": 0.26},
        {"dynamics": "double_integrator"},
        {"max_speed": 1.3},
    ]
    digests = {game.digest for game in (arena(1), arena(2), arena(3), *(arena(2, change) for change in deciding))}
    assert len(digests) == 3 + len(deciding)
    others: list[dict[str, Any]] = [
        {"discount": 0.91},
        {"obstacles": []},
        {"obstacles.0.radius": 0.14},
        {"drones.0.start_spread": 0.05},
        {"step_cost": 0.6},
        {"features.effort_scale": 0.4},
        {"features.distance_levels": (0.5, 0.2)},
    ]
    assert {arena(2, change).digest for change in others} == {arena(2).digest}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"drones.0.start": (0.5, 0.6)},
            "start of drone 1 touches the obstacle at (0.8, 0.6): expected 0.25 m between their middles; move one",
        ),
        (
            {"drones.0.goal_region.centre": (0.9, 0.7)},
            "goal_region of drone 1 touches the obstacle at (0.8, 0.6): expected 0.25 m",
        ),
        ({"drones.1.start": (1.7, 0.2)}, "start (1.7, 0.2) of drone 2: expected a place in the arena (1.6, 1.2)"),
        (
            {"drones.1.goal_region.centre": (0.2, -0.1)},
            "goal_region (0.2, -0.1) of drone 2: expected a place in the arena (1.6, 1.2)",
        ),
        (
            {"drones.1.start": (0.79, 0.2)},
            "drones 1 and 2 may start closer than least_distance 0.3 m; move their starts apart, or make start_spread",
        ),
        (
            {"features.cost_spacing": 0.002},
            "features.cost_spacing 0.002 makes 962802 RBF features, expected at most 100000",
        ),
        ({"features.reward_spacing": 1e-6}, "features.reward_spacing 1e-06 makes"),
        ({"features.cost_spacing": 1e-320}, "greater than or equal to 0.000001"),
        ({"features.cost_width": 0}, "greater than or equal to 0.000001"),
        ({"drones.0.goal_region.radius": 1e-200}, "greater than or equal to 0.000001"),
        ({"arena": (1.6, 1001.0)}, "less than or equal to 1000"),
        ({"arena": (1.6, float("nan"))}, "finite number"),
        ({"drones": []}, "at least 1 item"),
        ({"dynamics": "hover"}, "single_integrator"),
        ({"gravity": 9.81}, "Extra inputs are not permitted"),
    ],
    ids=str,
)
def test_settings_that_make_no_game_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        arena_settings(2, changes)
    assert message in str(caught.value)


def test_starts_may_just_keep_their_distances() -> None:
    """The obstacle's 0.25 m and the least 0.3 m, from the nearest corners of the starts' squares."""
    corner = 0.25 / np.sqrt(2) + 1e-9
    settings = arena_settings(1, {"drones.0.start": (0.8 - corner - 0.1, 0.6 - corner - 0.1)})
    assert settings.n_experts == 1
    with pytest.raises(ValidationError, match="touches the obstacle"):
        arena_settings(1, {"drones.0.start": (0.8 - corner - 0.1 + 1e-6, 0.6 - corner - 0.1)})
    assert arena_settings(2, {"drones.1.start": (0.8 + 1e-9, 0.2)}).n_experts == 2


@pytest.mark.parametrize(
    ("spacing", "counts"), [(0.4, (5, 4)), (0.39, (6, 5)), (0.1, (17, 13)), (1.6, (2, 2)), (1000, (2, 2))]
)
def test_lattices_are_no_coarser_than_asked_for(spacing: float, counts: tuple[int, int]) -> None:
    assert arena_settings(1).lattice(spacing) == counts
