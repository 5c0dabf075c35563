"""How well learned constraints agree with true ones.

With L the learned and C the true constraints among K cost features:

    false discovery rate  |L - C| / |L|      the paper's "FPR": share of what was learned that is not true
    false positive rate   |L - C| / |not C|  share of the harmless features that were learned
    false negative rate   |C - L| / |C|
    AUC                   P(score of a true constraint > score of a harmless feature), ties count half
                          (Hanley and McNeil, 1982)

A rate over an empty set is 0; an AUC where one of the classes is empty is not defined.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Mask, Vector


class ConstraintErrors(NamedTuple):
    """Rates in [0, 1]."""

    false_positive_rate: float
    false_negative_rate: float
    false_discovery_rate: float


def by_threshold(omega: Vector, threshold: float) -> Mask:
    """Where the learned cost -omega exceeds the threshold: the paper's rule, which depends on the gauge.

    Parameters
    ----------
    omega : Vector
        Cost weights, shape (K,).
    threshold : float
        Cost from which on a feature is a constraint.

    Returns
    -------
    Mask
        Shape (K,).
    """
    return -omega > threshold


def surest_first(names: Sequence[str], confidences: Vector, level: float) -> dict[str, float]:
    """Constraints by name, each with its confidence.

    Parameters
    ----------
    names : Sequence[str]
        Of all features, shape (K,).
    confidences : Vector
        Shape (K,).
    level : float
        q: confidence from which on a feature is a constraint.

    Returns
    -------
    dict[str, float]
        The surest first.
    """
    order = np.argsort(-confidences, kind="stable")
    return {names[int(k)]: float(confidences[k]) for k in order if confidences[k] >= level}


def constraint_errors(learned: Mask, true_constraints: Mask) -> ConstraintErrors:
    """Rates of what was learned against what is true.

    Parameters
    ----------
    learned : Mask
        What was called a constraint, shape (K,).
    true_constraints : Mask
        What is one, shape (K,).

    Returns
    -------
    ConstraintErrors
        Rates in [0, 1].
    """
    false, missed = int((learned & ~true_constraints).sum()), int((~learned & true_constraints).sum())
    return ConstraintErrors(
        false / max(1, int((~true_constraints).sum())),
        missed / max(1, int(true_constraints.sum())),
        false / max(1, int(learned.sum())),
    )


def ranking_auc(scores: Vector, true_constraints: Mask) -> float | None:
    """AUC of a ranking.

    Parameters
    ----------
    scores : Vector
        The surer a constraint, the higher, shape (K,).
    true_constraints : Mask
        Shape (K,).

    Returns
    -------
    float or None
        In [0, 1]; None where there are only true or only harmless features.
    """
    true, harmless = scores[true_constraints], scores[~true_constraints]
    if not (len(true) and len(harmless)):
        return None
    above = (true[:, None] > harmless).sum() + 0.5 * (true[:, None] == harmless).sum()
    return float(above / (len(true) * len(harmless)))
