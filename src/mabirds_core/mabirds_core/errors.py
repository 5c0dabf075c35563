"""The package's exceptions: every one names the value, what was expected, and the remedy."""


class MabirdsError(ValueError):
    """Input that cannot be used; the message is meant for the person who gave it."""


class ExperimentError(MabirdsError):
    """An experiment file or one of its settings is wrong."""


class ScheduleError(MabirdsError):
    """An edge schedule breaks an assumption of the algorithm, or names learners that do not exist."""


class ImpossibleTrajectoryError(MabirdsError):
    """A trajectory has the wrong shape, or a step that the game's dynamics do not allow."""


class CheckpointError(MabirdsError):
    """A checkpoint that cannot be written or must not be used."""


class DivergenceError(MabirdsError):
    """The iteration left the range of numbers."""


class InfeasibleError(MabirdsError):
    """No trajectory from a start satisfies the hard constraints."""


class UnknownTruthError(MabirdsError):
    """Something is asked that cannot be said without knowing what experts really may do."""


class RefusedMessageError(MabirdsError):
    """A message that must not be used.

    Parameters
    ----------
    reason : str
        A short name to count by.
    explanation : str
        For people.
    """

    def __init__(self, reason: str, explanation: str) -> None:
        super().__init__(explanation)
        self.reason = reason
