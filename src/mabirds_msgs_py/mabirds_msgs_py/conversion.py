"""Messages to arrays and back. What does not fit is refused with a named reason, before it reaches an algorithm."""

from array import array
from typing import Any, get_args

import numpy as np
from builtin_interfaces.msg import Time
from mabirds_msgs.msg import Demonstration
from mabirds_msgs.msg import EdgeSchedule as EdgeScheduleMessage
from mabirds_msgs.msg import Parameters as ParametersMessage
from numpy.typing import NDArray

from mabirds_core.algorithm.parameters import MAX_PARAMETER, Parameters
from mabirds_core.consensus.schedule import EdgeSchedule, End, require_size
from mabirds_core.consensus.weights import Edge
from mabirds_core.digest import arithmetic_differs
from mabirds_core.errors import ImpossibleTrajectoryError, RefusedMessageError, ScheduleError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.texts import sanitize, truncate
from mabirds_msgs_py.demonstration_origin import network_of

NANOSECONDS = 1_000_000_000

ENDS: tuple[End, ...] = get_args(End)
"""What may follow the last slot of a schedule; messages do not say which, but the digest depends on it."""


def time_message(nanoseconds: int) -> Time:
    """Nanoseconds since the epoch as a message."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=seconds, nanosec=rest)


def nanoseconds(time: Time) -> int:
    """Inverse of ``time_message``."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def floats(values: NDArray[np.float64]) -> array:
    """Values as what float64[] fields take fastest; row-major."""
    result = array("d")
    result.frombytes(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return result


def demonstration_message(
    game: ConstrainedMarkovGame, learner: str, iteration: int, trajectory: Trajectories, stamp: int
) -> Demonstration:
    """Write a demonstration.

    Parameters
    ----------
    game : ConstrainedMarkovGame
        Of the trajectory.
    learner : str
        For whom it is.
    iteration : int
        n.
    trajectory : Trajectories
        zeta(n), one trajectory.
    stamp : int
        When it was demonstrated, in nanoseconds.

    Returns
    -------
    Demonstration
        It names no network.
    """
    states, actions = game.encode(trajectory)
    message = Demonstration(learner=learner, iteration=iteration, game_digest=game.digest)
    message.header.stamp = time_message(stamp)
    message.steps, message.state_size = states.shape
    message.action_size = actions.shape[1]
    message.states, message.actions = floats(states), floats(actions)
    return message


def read_demonstration(
    game: ConstrainedMarkovGame, learner: str, message: Demonstration, experiment_digest: str = ""
) -> Trajectories:
    """Read a demonstration.

    Parameters
    ----------
    game : ConstrainedMarkovGame
        Of the trajectory.
    learner : str
        For whom it must be.
    message : Demonstration
        As it came.
    experiment_digest : str, optional
        Of the run; a message that names a network must name this one.

    Returns
    -------
    Trajectories
        One trajectory.

    Raises
    ------
    RefusedMessageError
        It is for another learner, network or game, or is no trajectory of this one.
    """
    _require("wrong_learner", "learner", message.learner, learner)
    if network := network_of(message):
        require_experiment(network, experiment_digest)
    _require("wrong_game", "game digest", message.game_digest, game.digest)
    arrays = []
    for name, columns in (("states", message.state_size), ("actions", message.action_size)):
        values = np.frombuffer(getattr(message, name), dtype=np.float64)
        if values.size != message.steps * columns:
            raise RefusedMessageError(
                "wrong_shape", f"{name}: {values.size} numbers, expected {message.steps} x {columns}"
            )
        arrays.append(values.reshape(message.steps, columns))
    try:
        return game.decode(*arrays)
    except ImpossibleTrajectoryError as error:
        raise RefusedMessageError("impossible_trajectory", str(error)) from None


def parameters_message(
    learner: str, iteration: int, parameters: Parameters, experiment_digest: str, schedule_digest: str, stamp: int
) -> ParametersMessage:
    """Write parameters.

    Parameters
    ----------
    learner : str
        Whose they are.
    iteration : int
        n.
    parameters : Parameters
        theta(n), omega(n).
    experiment_digest : str
        Of the run.
    schedule_digest : str
        Of E(n).
    stamp : int
        The present time, in nanoseconds.

    Returns
    -------
    ParametersMessage
        For everybody who listens.
    """
    return ParametersMessage(
        stamp=time_message(stamp),
        learner=learner,
        iteration=iteration,
        experiment_digest=experiment_digest,
        schedule_digest=schedule_digest,
        theta=floats(parameters.theta),
        omega=floats(parameters.omega),
    )


def read_parameters(
    message: ParametersMessage, learner: str, experiment_digest: str, schedule_digest: str, like: Parameters
) -> Parameters:
    """Read parameters.

    Parameters
    ----------
    message : ParametersMessage
        As it came.
    learner : str
        From whom it must be.
    experiment_digest : str
        Of the run.
    schedule_digest : str
        Of E(n).
    like : Parameters
        Parameters of the shapes that they must have.

    Returns
    -------
    parameters : Parameters
        theta and omega.

    Raises
    ------
    RefusedMessageError
        It is not from this learner in this network, of other shapes, or its numbers are no parameters.
    """
    require_sender(message, learner, experiment_digest, schedule_digest)
    for name, size in (("theta", like.theta.size), ("omega", like.omega.size)):
        if len(getattr(message, name)) != size:
            raise RefusedMessageError("wrong_shape", f"{name}: {len(getattr(message, name))} numbers, expected {size}")
    return arrays(message)


def require_sender(message: Any, learner: str, experiment_digest: str, schedule_digest: str) -> None:
    """Check that parameters or a status are from a learner of this network.

    Parameters
    ----------
    message : Any
        As it came.
    learner : str
        From whom it must be.
    experiment_digest : str
        Of the run.
    schedule_digest : str
        Of E(n).

    Raises
    ------
    RefusedMessageError
        It is from somebody else.
    """
    require_learner(message, learner, experiment_digest)
    _require("wrong_schedule", "schedule digest", message.schedule_digest, schedule_digest)


def require_learner(message: Any, learner: str, experiment_digest: str) -> None:
    """Check that a message is from a learner of this run.

    Parameters
    ----------
    message : Any
        As it came.
    learner : str
        From whom it must be.
    experiment_digest : str
        Of the run.

    Raises
    ------
    RefusedMessageError
        It is from somebody else.
    """
    _require("wrong_learner", "learner", message.learner, learner)
    require_experiment(message.experiment_digest, experiment_digest)


def require_experiment(given: str, expected: str) -> None:
    """Check that a message is from this run, and from a process that computes alike.

    Parameters
    ----------
    given : str
        Experiment digest of the message.
    expected : str
        Of the run.

    Raises
    ------
    RefusedMessageError
        It is from another run, or its sender's arithmetic is another.
    """
    if given == expected:
        return
    if (difference := arithmetic_differs(given, expected)) is not None:
        raise RefusedMessageError("wrong_arithmetic", difference)
    _require("wrong_experiment", "experiment digest", given, expected)


def arrays(message: ParametersMessage) -> Parameters:
    """theta and omega of any sender and of any shapes: for showing.

    Raises
    ------
    RefusedMessageError
        Numbers are not finite or above MAX_PARAMETER, which neither parameters nor means of such exceed.
    """
    return Parameters(_vector("theta", message.theta), _vector("omega", message.omega))


def _vector(name: str, values: array) -> NDArray[np.float64]:
    vector = np.frombuffer(values, dtype=np.float64).copy()
    if (np.abs(vector) <= MAX_PARAMETER).all():  # which no NaN is
        return vector
    for reason, bad, expectation in (
        ("not_finite", ~np.isfinite(vector), "a finite number"),
        ("too_large", np.abs(vector) > MAX_PARAMETER, f"at most {MAX_PARAMETER:g} in absolute value"),
    ):
        if bad.any():
            place = int(np.flatnonzero(bad)[0])
            raise RefusedMessageError(reason, f"{name}[{place}] is {vector[place]:g}, expected {expectation}")
    return vector


def _require(reason: str, what: str, given: str, expected: str) -> None:
    if given != expected:
        raise RefusedMessageError(reason, f"{what} {truncate(given)!r}, expected {expected!r}")


def schedule_message(schedule: EdgeSchedule) -> EdgeScheduleMessage:
    """The schedule as a message."""
    edges = [(slot, *edge) for slot, edges in enumerate(schedule.slots) for edge in sorted(edges)]
    message = EdgeScheduleMessage(digest=schedule.digest, learners=list(schedule.learners), slots=len(schedule.slots))
    message.edge_slot, message.sender, message.receiver = (
        array("I", [edge[column] for edge in edges]) for column in range(3)
    )
    return message


def read_schedule(message: EdgeScheduleMessage) -> EdgeSchedule:
    """The schedule in a message.

    Raises
    ------
    RefusedMessageError
        It is no schedule, or its digest does not confirm it.
    """
    if not len(message.edge_slot) == len(message.sender) == len(message.receiver):
        raise RefusedMessageError("wrong_shape", "edge_slot, sender and receiver: expected one number per edge in each")
    if message.edge_slot and max(message.edge_slot) >= message.slots:
        raise RefusedMessageError(
            "impossible_schedule", f"slot {max(message.edge_slot)}, expected less than {message.slots}"
        )
    try:
        require_size(max(1, len(message.learners)), message.slots)
        slots: list[set[Edge]] = [set() for _ in range(message.slots)]
        for slot, sender, receiver in zip(message.edge_slot, message.sender, message.receiver, strict=True):
            slots[slot].add((sender, receiver))
        candidates = [EdgeSchedule(tuple(message.learners), tuple(map(frozenset, slots)), end) for end in ENDS]
    except ScheduleError as error:
        raise RefusedMessageError("impossible_schedule", sanitize(str(error))) from None
    matching = [schedule for schedule in candidates if schedule.digest == message.digest]
    if not matching:
        raise RefusedMessageError("wrong_schedule", f"digest {truncate(message.digest)!r} is not that of its content")
    return matching[0]
