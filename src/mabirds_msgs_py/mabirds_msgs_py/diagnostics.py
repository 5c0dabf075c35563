"""What a node tells /diagnostics: one status of key-value pairs, as rqt and Foxglove show them."""

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

PERIOD = 1.0
"""Seconds between two messages to /diagnostics, as diagnostic aggregators expect."""

DEPTH = 10
"""The default depth of /diagnostics."""


def diagnostic_message(
    name: str, what: str, sentence: str, values: Mapping[str, object], stamp: Time, *, warning: bool
) -> DiagnosticArray:
    """Tell what a node does.

    Parameters
    ----------
    name : str
        Of the node.
    what : str
        It does.
    sentence : str
        How it stands with that.
    values : Mapping[str, object]
        By name, for people.
    stamp : Time
        The present time.
    warning : bool
        Somebody needs to look.

    Returns
    -------
    DiagnosticArray
        With one status.
    """
    status = DiagnosticStatus(
        level=DiagnosticStatus.WARN if warning else DiagnosticStatus.OK,
        name=f"{name}: {what}",
        hardware_id=name,
        message=sentence,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message
