"""Messages of resilient mode to running sums and members, and back."""

from array import array

import numpy as np
from mabirds_msgs.msg import Mass, Membership

from mabirds_core.arrays import Vector
from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.errors import RefusedMessageError
from mabirds_core.texts import truncate
from mabirds_msgs_py.conversion import floats

MAX_SUM = 1e20
"""Sums over a million iterations of the largest parameters stay below this."""


def mass_message(learner: str, receiver: str, epoch: int, iteration: int, total: RunningSum) -> Mass:
    """All that ``learner`` sent to ``receiver`` up to ``iteration``; stamp and digests are the sender's to fill in."""
    return Mass(
        learner=learner,
        receiver=receiver,
        epoch=epoch,
        iteration=iteration,
        total=floats(total.total),
        rest=floats(total.rest),
    )


def read_mass(
    message: Mass, learner: str, receiver: str, experiment_digest: str, schedule_digest: str, size: int
) -> RunningSum:
    """The running sum in a message from ``learner`` to ``receiver``; raises RefusedMessageError for all others."""
    for reason, what, given, expected in (
        ("wrong_learner", "learner", message.learner, learner),
        ("wrong_learner", "receiver", message.receiver, receiver),
        ("wrong_experiment", "experiment digest", message.experiment_digest, experiment_digest),
        ("wrong_schedule", "schedule digest", message.schedule_digest, schedule_digest),
    ):
        if given != expected:
            raise RefusedMessageError(reason, f"{what} {truncate(given)!r}, expected {expected!r}")
    return RunningSum(_numbers("total", message.total, size), _numbers("rest", message.rest, size))


def _numbers(name: str, values: array, size: int) -> Vector:
    numbers = np.frombuffer(values, dtype=np.float64).copy()
    if numbers.size != size:
        raise RefusedMessageError("wrong_shape", f"{name}: {numbers.size} numbers, expected {size}")
    if not np.isfinite(numbers).all():
        raise RefusedMessageError("not_finite", f"{name}: expected finite numbers")
    if (np.abs(numbers) > MAX_SUM).any():
        raise RefusedMessageError("too_large", f"{name}: expected at most {MAX_SUM:g} in absolute value")
    return numbers


def membership_message(experiment_digest: str, epoch: int, members: list[str]) -> Membership:
    """A declaration; the stamp is the sender's to fill in."""
    return Membership(experiment_digest=experiment_digest, epoch=epoch, members=members)


def read_membership(message: Membership, experiment_digest: str) -> list[str]:
    """The members of a declaration for this network; raises RefusedMessageError for all others."""
    if message.experiment_digest != experiment_digest:
        raise RefusedMessageError(
            "wrong_experiment",
            f"experiment digest {truncate(message.experiment_digest)!r}, expected {experiment_digest!r}",
        )
    return list(message.members)
