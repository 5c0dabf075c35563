"""What a monitor believes: messages that the learners of its experiment can have sent, in this run."""

from collections.abc import Mapping, Sequence
from functools import cached_property

from mabirds_msgs.msg import Constraints, EdgeSchedule, FeatureNames, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game, build_learner, build_method
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.names import parameter_names
from mabirds_core.texts import truncate
from mabirds_learner.diagnostics import HARMLESS
from mabirds_learner.inbox import check_iteration
from mabirds_msgs_py.constraints_conversion import read_constraints
from mabirds_msgs_py.conversion import read_parameters, require_learner, require_sender, schedule_message

EXPECTED = HARMLESS | {"wrong_experiment", "wrong_schedule"}
"""Reasons of drops that are no trouble: repetitions, and other runs in the same ROS domain."""


class MessageValidator:
    """Checks messages; ``names``: who learns, the experiment's learners or a central method. ``run``: of this run.

    Every method raises RefusedMessageError for what does not fit.
    """

    def __init__(self, experiment: Experiment, run: str, names: Sequence[str]) -> None:
        self._experiment, self.digest = experiment, experiment.run_digest(run)
        self._schedule = experiment.edge_schedule
        self.initial = {name: initial_parameters(experiment, name) for name in names}
        closing = experiment.closing_rounds if set(names) <= set(experiment.learners) else 0
        self.last = experiment.iterations + closing + 1  # the iteration after which nothing is left to do

    @cached_property
    def _schedule_message(self) -> EdgeSchedule:
        return schedule_message(self._schedule)

    def parameters(self, name: str, message: ParametersMessage, received: Mapping[int, Parameters]) -> Parameters:
        """theta(n), omega(n) of ``name``; ``known``: those that it has sent before, by iteration."""
        parameters = read_parameters(message, name, self.digest, self._schedule.digest, self.initial[name])
        check_iteration(message.iteration, 1, received, self.last, parameters)
        return parameters

    def status(self, name: str, message: LearnerStatus) -> None:
        """Is it from ``name``, and can a learner of this experiment say that of itself?"""
        try:
            require_sender(message, name, self.digest, self._schedule.digest)
        except RefusedMessageError as error:
            if error.reason == "wrong_experiment":
                raise RefusedMessageError(error.reason, f"{error}; {self._what_differs(message)}") from None
            raise
        strangers = sorted(set(message.mixed_from) - set(self._experiment.learners))
        for what, value, possible in (
            ("iteration", message.iteration, 1 <= message.iteration <= self.last),
            (
                "last_demonstration",
                message.last_demonstration,
                message.last_demonstration <= self._experiment.iterations,
            ),
            ("mixed_from", truncate(str(strangers)), not strangers),
        ):
            if not possible:
                raise RefusedMessageError(
                    "impossible_status", f"{what} {value}: no learner of this experiment says that"
                )

    def _what_differs(self, message: LearnerStatus) -> str:
        """Which part of the experiment another run of it has otherwise, as far as digests tell."""
        parts = [
            part
            for part, theirs, ours in (
                ("game", message.game_digest, self._game_digest),
                ("schedule", message.schedule_digest, self._schedule.digest),
            )
            if theirs != ours
        ]
        rest = "algorithm, learners, mixing, iterations, closing_rounds or seed, or the name of the run"
        return f"different: {' and '.join(parts)}" if parts else f"game and schedule are the same: it is {rest}"

    @cached_property
    def _game_digest(self) -> str:
        return build_game(self._experiment).digest

    def constraints(self, name: str, message: Constraints) -> None:
        """Are they of ``name``, and of cost features of this experiment?"""
        require_learner(message, name, self.digest)
        strangers = sorted(set(read_constraints(message)) - self._features)
        if strangers:
            raise RefusedMessageError(
                "impossible_constraints", f"{truncate(strangers[0])!r}: expected a cost feature of this experiment"
            )

    def feature_names(self, name: str, message: FeatureNames) -> None:
        """Are they of ``name``, and those of this experiment?"""
        require_learner(message, name, self.digest)
        expected = parameter_names(self._experiment, name, build_game(self._experiment))
        if (*message.theta, *message.omega) != (*expected.theta, *expected.omega):
            raise RefusedMessageError("impossible_names", "expected the names of this experiment's features")

    @cached_property
    def _features(self) -> set[str]:
        return set(build_game(self._experiment).cost_features.names)

    def schedule(self, message: EdgeSchedule) -> None:
        """Is it the schedule of the experiment?"""
        if message != self._schedule_message:
            digest = truncate(message.digest)
            raise RefusedMessageError(
                "wrong_schedule", f"schedule of digest {digest!r}, expected that of {self._schedule.digest!r}"
            )


def initial_parameters(experiment: Experiment, name: str) -> Parameters:
    """What the learner or central method ``name`` begins with."""
    if name in experiment.learners:
        return build_learner(experiment, name).initial_state().parameters
    return build_method(experiment, name).initial_state().parameters
