"""Messages of resilient mode to running sums and members, and back."""

from array import array

import numpy as np
from mabirds_msgs.msg import Mass, Membership

from mabirds_core.arrays import Vector
from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.errors import RefusedMessageError
from mabirds_core.texts import truncate
from mabirds_msgs_py.conversion import floats, require_experiment
from mabirds_msgs_py.declaration_key import signed, verified

MAX_SUM = 1e20
"""Sums over a million iterations of the largest parameters stay below this."""


def mass_message(learner: str, receiver: str, epoch: int, iteration: int, total: RunningSum) -> Mass:
    """All that a learner sent to another up to an iteration.

    Parameters
    ----------
    learner : str
        Who sends.
    receiver : str
        To whom.
    epoch : int
        Of the membership.
    iteration : int
        n.
    total : RunningSum
        sigma(n).

    Returns
    -------
    Mass
        Stamp and digests are the sender's to fill in.
    """
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
    """Read a message of mass.

    Parameters
    ----------
    message : Mass
        As it came.
    learner : str
        From whom it must be.
    receiver : str
        For whom.
    experiment_digest : str
        Of the run.
    schedule_digest : str
        Of E(n).
    size : int
        K_theta + K_omega + 1.

    Returns
    -------
    RunningSum
        sigma.

    Raises
    ------
    RefusedMessageError
        It is not from this learner to this receiver in this network, or its numbers cannot be a sum.
    """
    require_experiment(message.experiment_digest, experiment_digest)
    for reason, what, given, expected in (
        ("wrong_learner", "learner", message.learner, learner),
        ("wrong_learner", "receiver", message.receiver, receiver),
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


def membership_message(experiment_digest: str, epoch: int, members: list[str], key: bytes = b"") -> Membership:
    """Declare who takes part.

    Parameters
    ----------
    experiment_digest : str
        Of the run.
    epoch : int
        Counts the declarations.
    members : list[str]
        Names.
    key : bytes, optional
        With which it is signed; empty: it is not.

    Returns
    -------
    Membership
        The stamp is the sender's to fill in.
    """
    declared = signed(members, experiment_digest, epoch, key)
    return Membership(experiment_digest=experiment_digest, epoch=epoch, members=declared)


def read_membership(message: Membership, experiment_digest: str, key: bytes = b"") -> list[str]:
    """Read a declaration of who takes part.

    Parameters
    ----------
    message : Membership
        As it came.
    experiment_digest : str
        Of the run.
    key : bytes, optional
        With which it must be signed; empty: whoever declares is believed.

    Returns
    -------
    list[str]
        The members' names.

    Raises
    ------
    RefusedMessageError
        It is for another network, or not signed.
    """
    require_experiment(message.experiment_digest, experiment_digest)
    return verified(message.members, experiment_digest, message.epoch, key)
