"""QoS profiles, one per kind of topic (docs/operations.md explains the choices)."""

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

LIVELINESS_LEASE = 3.0
"""Seconds of silence after which the middleware calls a process dead."""


def latched(depth: int) -> QoSProfile:
    """Reliable, transient local, keep last: a late joiner gets what it missed, up to ``depth`` messages."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


def announced(depth: int) -> QoSProfile:
    """``latched``, and the middleware tells within LIVELINESS_LEASE seconds when the publisher's process is gone."""
    profile = latched(depth)
    profile.liveliness = LivelinessPolicy.AUTOMATIC
    profile.liveliness_lease_duration = Duration(seconds=LIVELINESS_LEASE)
    return profile


STATUS_QOS = latched(1)
"""Only the newest status matters."""
