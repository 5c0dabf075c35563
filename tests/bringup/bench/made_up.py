"""Results made up by hand."""

from typing import Any

import polars as pl

from mabirds_bringup.bench.frame import frame_of
from mabirds_bringup.bench.results import CaseResult, curve, entries

CURVES = {
    "violation_rate": [0.9, 0.5, 0.04, 0.01],
    "success_rate": [0.0, 0.5, 0.8, 0.98],
    "actor_success_rate": [],
    "seconds": [0.2, 0.4],
    "consensus_theta": [0.0, 2.0, 1.0, 0.1],
    "consensus_omega": [0.0, 4.0, 2.0, 0.2],
}
NUMBERS = {
    "false_positive_rate": 0.02,
    "gradient_steps": 2,
    "policy_solves": 4,
    "peak_memory": 400.0,
    "policy_distance": 0.05,
    "same_constraints": 1.0,
    "omega": [-0.1, -0.3, 1.0],
}


def results(label: str = "MA-BIRDS", learner: str = "learner_1", seed: int = 1, **changes: Any) -> pl.DataFrame:
    """Two updates of 0.2 s and 0.4 s, and a closing round; ``changes``: metrics, or the group."""
    group = changes.pop("group", "main")
    curves = {metric: changes.pop(metric, values) for metric, values in CURVES.items()}
    rows = [row for metric, values in curves.items() for row in curve(metric, values, first=int(metric == "seconds"))]
    return frame_of([CaseResult(group, label, learner, seed, [*rows, *entries(3, **{**NUMBERS, **changes})])])
