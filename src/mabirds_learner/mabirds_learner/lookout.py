"""Who else is there, or nobody: what the ROS graph tells a learner that its messages do not."""

from collections.abc import Callable
from typing import NamedTuple

from mabirds_msgs_py.solitude import Solitude, nobody_heard

LOOKS = 3
"""In a row that must agree: processes that end leave the graph later than those that take their place enter it."""

ALONE = 1.5
"""Seconds without anybody after which looks count for solitude; it is said within five."""


class Sight(NamedTuple):
    """What is seen in one look.

    Attributes
    ----------
    players : int
        That play to this learner in its run.
    namesakes : int
        Processes that are this learner in its run, itself among them.
    others : int
        That this learner can hear, players and neighbours.
    """

    players: int
    namesakes: int
    others: int


class Lookout:
    """Says once what people should know of who is there.

    Parameters
    ----------
    name : str
        Of the learner.
    look : Callable[[], Sight]
        Takes a look.
    say : Callable[[str], None]
        Tells people.
    """

    def __init__(self, name: str, look: Callable[[], Sight], say: Callable[[str], None]) -> None:
        self._name, self._look, self._say = name, look, say
        self._said, self._before = "", [""] * LOOKS
        self._solitude = Solitude(ALONE)

    def on_timer(self) -> None:
        """Look, and say what is new and lasts."""
        sight = self._look()
        alone = self._solitude.lasts(anybody=sight.others > 0)
        words = self._words(sight) or (nobody_heard("a player nor a neighbour") if alone else "")
        self._before = [*self._before[1:], words]
        if words != self._said and all(before == words for before in self._before):
            self._said = words
            if words:
                self._say(words)

    def _words(self, sight: Sight) -> str:
        if sight.namesakes > 1:
            return f"{sight.namesakes} processes of this run are {self._name}; end all but one"
        if sight.players > 1:
            return (
                f"a second expert_player plays to {self._name}, unless one was killed in the last 20 s; end all but one"
            )
        return ""
