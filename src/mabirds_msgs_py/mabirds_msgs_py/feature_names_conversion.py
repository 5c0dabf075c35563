"""What the numbers of parameters are called, to messages and back."""

from mabirds_msgs.msg import FeatureNames

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.names import ParameterNames
from mabirds_core.texts import truncate

MAX_NAMES, MAX_LETTERS = 1_000_000, 200
"""Names, and characters of one, that are taken for such: what others send is not kept without a limit."""


def feature_names_message(names: ParameterNames) -> FeatureNames:
    """Write names, without sender and digest."""
    return FeatureNames(theta=list(names.theta), omega=list(names.omega))


def read_feature_names(message: FeatureNames) -> ParameterNames:
    """Names of any sender, for showing.

    Raises
    ------
    RefusedMessageError
        There are too many, one is too long, or two cost features have the same.
    """
    for part, names in (("theta", message.theta), ("omega", message.omega)):
        if len(names) > MAX_NAMES:
            raise RefusedMessageError("wrong_shape", f"{part}: {len(names)} names, expected at most {MAX_NAMES}")
        if long := next((name for name in names if len(name) > MAX_LETTERS), None):
            raise RefusedMessageError(
                "impossible_names", f"{part}: {truncate(long)!r}, expected at most {MAX_LETTERS} characters"
            )
    if len(set(message.omega)) != len(message.omega):
        raise RefusedMessageError("impossible_names", "omega: two cost features of one name, expected all different")
    return ParameterNames(tuple(message.theta), tuple(message.omega))
