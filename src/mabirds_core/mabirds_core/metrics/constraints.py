"""How well learned constraints agree with true ones.

With L the learned and C the true constraints among K cost features:

    false discovery rate  |L - C| / |L|      the paper's "FPR": share of what was learned that is not true
    false positive rate   |L - C| / |not C|  share of the harmless features that were learned
    false negative rate   |C - L| / |C|
    AUC                   P(score of a true constraint > score of a harmless feature), ties count half
                          (Hanley and McNeil, 1982)

A rate over an empty set is 0; an AUC where one of the classes is empty is not defined.
"""

from typing import NamedTuple

from mabirds_core.arrays import Mask, Vector


class ConstraintErrors(NamedTuple):
    """Rates in [0, 1]."""

    false_positive_rate: float
    false_negative_rate: float
    false_discovery_rate: float


def by_threshold(omega: Vector, threshold: float) -> Mask:
    """Where the learned cost -omega exceeds the threshold, shape (K,): the paper's rule, which depends on the gauge."""
    return -omega > threshold


def constraint_errors(learned: Mask, true_constraints: Mask) -> ConstraintErrors:
    """Rates of ``learned``, shape (K,), against ``true_constraints``, shape (K,)."""
    false, missed = int((learned & ~true_constraints).sum()), int((~learned & true_constraints).sum())
    return ConstraintErrors(
        false / max(1, int((~true_constraints).sum())),
        missed / max(1, int(true_constraints.sum())),
        false / max(1, int(learned.sum())),
    )


def ranking_auc(scores: Vector, true_constraints: Mask) -> float | None:
    """AUC of ``scores``, shape (K,); None where there are only true or only harmless features."""
    true, harmless = scores[true_constraints], scores[~true_constraints]
    if not (len(true) and len(harmless)):
        return None
    above = (true[:, None] > harmless).sum() + 0.5 * (true[:, None] == harmless).sum()
    return float(above / (len(true) * len(harmless)))
