"""What an experiment file says of drones in the place of agents that were observed."""

from typing import Any

from mabirds_core.arrays import Array
from mabirds_core.games.recordings import Goal, Observed

MARGIN = 0.01
"""By how much rectangles of starts are larger than was seen [m]."""


def observed_settings(observed: Observed) -> dict[str, Any]:
    """Settings of a game of drones that may be wherever agents were, and a planner for it.

    Parameters
    ----------
    observed : Observed
        Of the agents.

    Returns
    -------
    dict[str, Any]
        Parts of an experiment file: the game, the algorithm, the experts.
    """
    tasks = [
        {**_start(observed.starts[:, number]), "goal_region": _region(goal)}
        for number, goal in enumerate(observed.goals)
    ]
    game = {
        "kind": "drones",
        "arena": list(observed.sides),
        "drones": tasks,
        "time_step": observed.time_step,
        "horizon": observed.horizon,
        "max_speed": observed.max_speed,
        "truth": "unknown",
    }
    algorithm = {"rollouts": 64, "rollout_start": "demonstration", "policy": {"kind": "lattice"}}
    return {
        "game": game,
        "algorithm": algorithm,
        "demonstrations": {"experts": "pilots"},
        "constraint_threshold": 0.05,
    }


def _region(goal: Goal) -> dict[str, Any]:
    return {name: value for name, value in goal._asdict().items() if value is not None}


def _start(starts: Array) -> dict[str, Any]:
    """The rectangle of all starts (n, 2)."""
    low, high = starts.min(axis=0), starts.max(axis=0)
    half = (high - low) / 2 + MARGIN
    return {
        "start": [round(float(x), 4) for x in (low + high) / 2],
        "start_spread": [round(float(x), 4) for x in half],
    }
