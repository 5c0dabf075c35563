"""Games that were not learned as well as they were to be: why, and what was learned there."""

from collections.abc import Iterator, Mapping
from typing import Any

import polars as pl

from mabirds_bringup.bench.behaviour.draw import draw
from mabirds_bringup.evaluate.constraints import learned_constraints
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.whole_game import Learned

MAX_PICTURES = 12


def reason(worst: Mapping[str, Any]) -> str:
    """What a learner's least successful late iterate does in place of what it is to do."""
    what = "violates" if worst["worst_violation"] > worst["worst_too_late"] else "comes too late"
    share = max(worst["worst_violation"], worst["worst_too_late"])
    return f"{worst['learner']} at iteration {worst['worst_iteration']}: {what} in {share:.1%} of its trajectories"


def missed(rows: pl.DataFrame, success: float, late_success: float) -> list[dict[str, Any]]:
    """One entry per game in which a learner fails, of its worst learner.

    Parameters
    ----------
    rows : DataFrame
        Of one method, a row per game and learner.
    success, late_success : float
        What the final and the least late success rate are to be.

    Returns
    -------
    list[dict[str, Any]]
        Seed, network, learner, rates, that of the likeliest policy on the way to the pooled optimum, reason and map;
        the worst first.
    """
    failed = rows.filter((pl.col("success") < success) | (pl.col("late_minimum") < late_success))
    worst = failed.sort("late_minimum").unique("seed", keep="first", maintain_order=True)
    shown = ("seed", "experts", "learners", "schedule", "learner")
    rates = ("success", "late_minimum", "violation", "pooled_best_success")
    return [
        {**{column: row[column] for column in (*shown, *rates)}, "reason": reason(row), "map": row["game"]}
        for row in worst.to_dicts()
    ]


def pictures(misses: list[dict[str, Any]], game_kind: str, demonstrations: int) -> Iterator[tuple[str, Any]]:
    """What the worst learner of each game ended with, learned once more, by file name.

    Parameters
    ----------
    misses : list[dict[str, Any]]
        Of ``missed``; the first MAX_PICTURES are shown.
    game_kind : str
        Of ``draw``.
    demonstrations : int
        Of each learner.

    Yields
    ------
    tuple[str, Any]
        A file name, and the game's figure.
    """
    for miss in misses[:MAX_PICTURES]:
        problem = draw(miss["seed"], game_kind, demonstrations)
        experiment, name = problem.experiment, miss["learner"]
        game, last = build_game(experiment), simulate(experiment, problem.streams)[name][-1]
        policy = evaluation_policy(experiment, name, game)(last)
        constraints = learned_constraints(experiment, name, last, problem.streams, game).learned
        learned = {f"seed {miss['seed']}, {name}": Learned(policy, last.omega, constraints)}
        yield f"miss_{miss['seed']}.png", game.figure(learned, experiment.constraint_threshold, experiment.seed)
