"""QoS profiles, one a kind of topic (docs/operations.md explains the choices)."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy


def latched(depth: int) -> QoSProfile:
    """Reliable, transient local, keep last ``depth``: a late joiner gets what it missed, up to ``depth``."""
    return QoSProfile(
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
    )


STATUS_QOS = latched(1)
"""Only the newest status matters."""
