"""Messages to arrays and back. What does not fit is refused with a named reason, before it reaches an algorithm."""

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from mabirds_msgs.msg import Demonstration
from mabirds_msgs.msg import EdgeSchedule as EdgeScheduleMessage
from mabirds_msgs.msg import Parameters as ParametersMessage
from numpy.typing import NDArray

from mabirds_core.errors import ImpossibleTrajectoryError, MabirdsError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.parameters import Parameters
from mabirds_core.schedule import EdgeSchedule

NANOSECONDS = 1_000_000_000


class RefusedMessageError(MabirdsError):
    """A message that must not be used. ``reason`` is a short name to count by."""

    def __init__(self, reason: str, explanation: str) -> None:
        super().__init__(explanation)
        self.reason = reason


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
    """zeta(iteration) of ``learner``, demonstrated at ``stamp`` (nanoseconds)."""
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
    """The trajectory in a message meant for ``learner``; raises RefusedMessageError for all others.

    A message that names a network must name this one.
    """
    _require("wrong_learner", "learner", message.learner, learner)
    if message.experiment_digest:
        _require("wrong_experiment", "experiment digest", message.experiment_digest, experiment_digest)
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
    """theta(iteration), omega(iteration) of ``learner``."""
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
    """theta and omega of a message from ``learner``, of the shapes of ``like``; raises RefusedMessageError."""
    _require("wrong_learner", "learner", message.learner, learner)
    _require("wrong_experiment", "experiment digest", message.experiment_digest, experiment_digest)
    _require("wrong_schedule", "schedule digest", message.schedule_digest, schedule_digest)
    return Parameters(
        _vector("theta", message.theta, like.theta.size), _vector("omega", message.omega, like.omega.size)
    )


def arrays(message: ParametersMessage) -> Parameters:
    """theta and omega of any parameters message, unchecked: for showing, not for mixing."""
    return Parameters(np.frombuffer(message.theta).copy(), np.frombuffer(message.omega).copy())


def _vector(name: str, values: array, size: int) -> NDArray[np.float64]:
    vector = np.frombuffer(values, dtype=np.float64)
    if vector.size != size:
        raise RefusedMessageError("wrong_shape", f"{name}: {vector.size} numbers, expected {size}")
    if not np.isfinite(vector).all():
        place = int(np.flatnonzero(~np.isfinite(vector))[0])
        raise RefusedMessageError("not_finite", f"{name}[{place}] is {vector[place]}, expected a finite number")
    return vector.copy()


def _require(reason: str, what: str, given: str, expected: str) -> None:
    if given != expected:
        raise RefusedMessageError(reason, f"{what} {given!r}, expected {expected!r}")


def schedule_message(schedule: EdgeSchedule) -> EdgeScheduleMessage:
    """The schedule as a message."""
    edges = [(slot, *edge) for slot, edges in enumerate(schedule.slots) for edge in sorted(edges)]
    message = EdgeScheduleMessage(digest=schedule.digest, learners=list(schedule.learners), slots=len(schedule.slots))
    message.edge_slot, message.sender, message.receiver = (
        array("I", [edge[column] for edge in edges]) for column in range(3)
    )
    return message
