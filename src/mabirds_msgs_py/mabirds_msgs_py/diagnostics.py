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
    """The message of node ``name`` about ``what`` it does, with a warning where it needs somebody to look."""
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
