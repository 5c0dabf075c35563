"""Where a player stands, as a message."""

from array import array
from collections.abc import Iterator

from mabirds_msgs.msg import PlayerStatus

from mabirds_expert_player.playback import LONG_WAIT, Playback
from mabirds_msgs_py.conversion import time_message


def player_status(playback: Playback, now: float) -> PlayerStatus:
    """Write a status.

    Parameters
    ----------
    playback : Playback
        What is played.
    now : float
        Seconds of the steady clock.

    Returns
    -------
    PlayerStatus
        Stamp, digest and answers are the player's to fill in.
    """
    (first, last), streams = playback.span, playback.streams.values()
    status = PlayerStatus(
        paused=playback.clock.paused,
        rate=playback.clock.rate,
        hz=playback.hz,
        loop=playback.loop,
        loops=playback.loops,
        learners=list(playback.streams),
        consumes=[stream.ready for stream in streams],
        waiting="; ".join(_waiting(playback, now)),
    )
    status.total = array("Q", [stream.total for stream in streams])
    status.sent = array("Q", [stream.sent for stream in streams])
    status.acknowledged = array("Q", [stream.acknowledged for stream in streams])
    status.first, status.last = time_message(first), time_message(last)
    status.at = time_message(playback.position(now))
    return status


def _waiting(playback: Playback, now: float) -> Iterator[str]:
    streams = playback.streams.items()
    if silent := [name for name, stream in streams if not (stream.ready or stream.looked_at)]:
        yield f"nothing heard of {', '.join(silent)}"
    if held := [name for name, stream in streams if stream.held_back]:
        yield f"{', '.join(held)} must learn first"
    wait = playback.next_wait(now)
    if wait and wait.seconds > LONG_WAIT:
        yield f"a gap in the recording, {wait.seconds:.0f} s more"
