"""Who takes part: the experiment's learners, until a declaration names fewer of them or names some again."""

from collections.abc import Iterable

from mabirds_core.consensus.assumptions import validate
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ScheduleError
from mabirds_core.texts import truncate


def restrict(schedule: EdgeSchedule, members: Iterable[str]) -> EdgeSchedule:
    """Leave only the edges between some of the learners; weights follow from what remains.

    Parameters
    ----------
    schedule : EdgeSchedule
        Of all learners.
    members : Iterable[str]
        Names of those who stay, in any order.

    Returns
    -------
    EdgeSchedule
        The members in the order of ``schedule.learners``, and the edges between them.

    Raises
    ------
    ScheduleError
        A member is none of the learners, there is no member, or what remains breaks Assumption 2 or 3.
    """
    chosen = set(members)
    if not chosen or not chosen <= set(schedule.learners):
        given = truncate(str(sorted(chosen)))
        raise ScheduleError(f"members {given}: expected some of the learners {list(schedule.learners)}")
    names = tuple(name for name in schedule.learners if name in chosen)
    new = {schedule.learners.index(name): number for number, name in enumerate(names)}
    slots = tuple(
        frozenset((new[sender], new[receiver]) for sender, receiver in slot if {sender, receiver} <= new.keys())
        for slot in schedule.slots
    )
    remaining = EdgeSchedule(names, slots, schedule.end)
    validate(remaining)
    return remaining
