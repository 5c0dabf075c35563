"""What the player tells /diagnostics."""

from collections.abc import Iterator, Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray

from mabirds_expert_player.stream import Stream
from mabirds_msgs_py.diagnostics import diagnostic_message


def playing_diagnostic(name: str, streams: Mapping[str, Stream], stamp: Time, *, paused: bool) -> DiagnosticArray:
    """Tell how playing stands.

    Parameters
    ----------
    name : str
        Of the player.
    streams : Mapping[str, Stream]
        By learner.
    stamp : Time
        The present time.
    paused : bool
        By a service.

    Returns
    -------
    DiagnosticArray
        By learner, what was sent and what the learner says it has learned.
    """
    values = {
        f"{learner}: {what}": getattr(stream, what)
        for learner, stream in streams.items()
        for what in ("sent", "acknowledged")
    }
    silent = [learner for learner, stream in streams.items() if not stream.ready]
    held_back = [learner for learner, stream in streams.items() if stream.held_back]
    sentence = "; ".join(_parts(silent, held_back, paused=paused)) or "playing"
    if all(stream.finished for stream in streams.values()):
        sentence = "finished"
    return diagnostic_message(name, "playing", sentence, values, stamp, warning=bool(silent or held_back))


def _parts(silent: list[str], held_back: list[str], *, paused: bool) -> Iterator[str]:
    if paused:
        yield "paused"
    if silent:
        yield f"nothing heard of {', '.join(silent)}"
    if held_back:
        yield f"held back by {', '.join(held_back)}"
