"""What is known of a learner, as plain values: what `mabirds inspect --json` prints and its tables show."""

import math
from typing import Any

import numpy as np

from mabirds_bringup.watch.inspector import WatchedLearner
from mabirds_bringup.watch.live_table import STATES
from mabirds_core.metrics.metrics import norms
from mabirds_msgs_py.constraints_conversion import read_constraints
from mabirds_msgs_py.conversion import arrays


def describe(learner: WatchedLearner, top: int) -> dict[str, Any]:
    """Everything about a learner as plain values; ``top``: how many of the costliest features."""
    content: dict[str, Any] = {"namespace": learner.namespace}
    if learner.status is not None:
        status = learner.status
        content |= {
            "state": STATES.get(status.state, f"unknown state {status.state}"),
            "iteration": status.iteration,
            "iterations_per_second": learner.rate,
            "waiting_for": list(status.waiting_for),
            "backlog": status.backlog,
            "last_demonstration": status.last_demonstration,
            "mixed_from": list(status.mixed_from),
            "metrics": dict(zip(status.metric_names, map(_number, status.metric_values), strict=False)),
            "dropped": dict(zip(status.drop_reasons, map(int, status.drop_counts), strict=False)),
            "message": status.message,
        }
    if learner.refused:
        content["refused"] = dict(learner.refused)
    if learner.parameters is not None:
        content["parameters"] = describe_parameters(learner, top)
    if learner.constraints is not None:
        message = learner.constraints
        content["constraints"] = {
            "iteration": message.iteration,
            "level": message.level,
            "undetermined": message.undetermined,
            "by_name": read_constraints(message),
        }
    return content


def describe_parameters(learner: WatchedLearner, top: int) -> dict[str, Any]:
    """Iteration, norms and the costliest features of the newest parameters; weights of a network are of no feature."""
    parameters, names = arrays(learner.parameters), learner.names.omega
    of_network = learner.feature_names is not None and not names
    order = np.argsort(parameters.omega, kind="stable")[: 0 if of_network else top]
    return {
        "iteration": learner.parameters.iteration if learner.parameters else None,
        **norms(parameters),
        "costliest": [
            {"feature": feature_name(names, int(k)), "cost": float(0.0 - parameters.omega[k])} for k in order
        ],
    }


def feature_name(names: tuple[str, ...], feature: int) -> str:
    """The name of a feature, or its number while names have not been heard."""
    return names[feature] if feature < len(names) else f"feature {feature}"


def _number(value: float) -> float | None:
    """The number as JSON knows it: NaN and infinity are no numbers there."""
    return value if math.isfinite(value) else None
