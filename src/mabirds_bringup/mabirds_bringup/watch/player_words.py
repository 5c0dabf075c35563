"""How a player stands, in few words."""

from mabirds_msgs.msg import PlayerStatus

from mabirds_bringup.watch.eta import eta_text
from mabirds_bringup.watch.player_view import played_seconds, speed, state
from mabirds_core.texts import sanitize


def player_words(status: PlayerStatus) -> str:
    """State, rate, progress and ETA in words."""
    sent, total = sum(status.sent), sum(status.total)
    at, end = played_seconds(status)
    left = eta_text(_left_at_hertz(status) if status.hz > 0 else (end - at) / max(status.rate, 1e-9))
    words = f"{state(status)} {speed(status)}, {sent}/{total} sent"
    if status.playing and left:
        words += f", {left} left"
    return words + (f", waits: {sanitize(status.waiting, 80)}" if status.waiting else "")


def _left_at_hertz(status: PlayerStatus) -> float:
    """Seconds that are left where demonstrations come at a rate of their own; every learner has one at a time."""
    missing = max((int(total) - int(sent) for total, sent in zip(status.total, status.sent, strict=False)), default=0)
    return missing / status.hz
