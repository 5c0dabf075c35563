"""Learners that wait for what was published long ago: they do not hear who published it, for whatever reason.

Two processes that begin while links, clocks and addresses change may meet all others and never each other. Both live,
and the run would wait for ever. Whoever hears both of them knows better.
"""

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple

from mabirds_bringup.run.processes import PLAYER
from mabirds_learner.learner_session import DEMONSTRATION

PATIENCE = 20.0
"""Seconds for which a learner waits for parameters that are known here, until it is started again."""

LONGER = 45.0
"""Seconds after which who published them is, since it may be that one."""

Missing = tuple[str, str, int]
"""Who waits, for whom, at which iteration."""


class Deaf(NamedTuple):
    """Who is to be started again.

    Attributes
    ----------
    name : str
        Of the learner.
    words : str
        Why.
    """

    name: str
    words: str


class Deafness:
    """Looks for such learners in what a monitor hears.

    ``own``: names of this host, which alone can be started again. ``clock``: seconds that only grow.
    """

    def __init__(self, own: Collection[str], clock: Callable[[], float] = time.monotonic) -> None:
        self._own, self._clock = own, clock
        self._since: dict[Missing, float] = {}
        self._unheard: dict[Missing, float] = {}
        self._first: dict[str, int] = {}
        self._told: dict[str, float] = {}

    def found(
        self,
        statuses: Mapping[str, Any],
        parameters: Mapping[str, Collection[int]],
        sent: Mapping[str, int],
        lost: Callable[[str], bool],
    ) -> list[Deaf]:
        """Those of this host that are to be started again now.

        ``statuses``: the newest of each learner. ``parameters``: of which iterations theta and omega are known.
        ``sent``: up to which iteration demonstrations are. ``lost``: is nothing heard of a learner any more? Then its
        status is old, and says nothing.
        """
        living = {name: status for name, status in statuses.items() if not lost(name)}
        now, missing = self._clock(), {*_missing(living, parameters), *_undelivered(living, sent)}
        self._since = {entry: self._since.get(entry, now) for entry in missing}
        deaf = [
            Deaf(name, _words(entry, now - since))
            for entry, since in self._since.items()
            for name in self._to_blame(entry, now - since)
        ]
        new = {name: words for name, words in deaf if now - self._told.get(name, -LONGER) > PATIENCE}
        self._told |= dict.fromkeys(new, now)
        return [Deaf(*entry) for entry in new.items()]

    def unheard(self, statuses: Mapping[str, Any], parameters: Mapping[str, Collection[int]]) -> str | None:
        """Why this process is deaf itself, in words: learners got on with what it has not heard for a while."""
        now = self._clock()
        for name, status in statuses.items():
            self._first.setdefault(name, status.iteration)
        missing = {
            (name, sender, status.iteration - 1)
            for name, status in statuses.items()
            for sender in (status.mixed_from if name in self._own and status.iteration > self._first[name] else ())
            if sender in parameters and status.iteration - 1 not in parameters[sender]
        }
        self._unheard = {entry: self._unheard.get(entry, now) for entry in missing}
        late = [entry for entry, since in self._unheard.items() if now - since > PATIENCE]
        if not late:
            return None
        name, sender, iteration = late[0]
        return f"{name} learned with parameters {iteration} of {sender}, which is not heard here for {PATIENCE:.0f} s"

    def _to_blame(self, entry: Missing, seconds: float) -> Iterator[str]:
        waiting, awaited, _ = entry
        if seconds > PATIENCE and waiting in self._own:
            yield waiting
        if seconds > LONGER and awaited in self._own:
            yield awaited


def _missing(statuses: Mapping[str, Any], parameters: Mapping[str, Collection[int]]) -> Iterator[Missing]:
    for name, status in statuses.items():
        for sender in status.waiting_for:
            if status.iteration in parameters.get(sender, ()):
                yield name, sender, status.iteration


def _undelivered(statuses: Mapping[str, Any], sent: Mapping[str, int]) -> Iterator[Missing]:
    """Who waits for demonstrations that the player sent."""
    for name, status in statuses.items():
        if DEMONSTRATION in status.waiting_for and status.iteration <= sent.get(name, 0):
            yield name, PLAYER, status.iteration


def _words(entry: Missing, seconds: float) -> str:
    waiting, awaited, iteration = entry
    if awaited == PLAYER:
        return f"{waiting} has waited for {seconds:.0f} s for demonstration {iteration}, which {PLAYER} sent"
    return f"{waiting} has waited for {seconds:.0f} s for parameters {iteration} of {awaited}, which are known here"
