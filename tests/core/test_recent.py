"""Values of living objects are found once."""

import gc
import weakref

from mabirds_core.recent import Recent


class Thing:
    """Equal to all others, and no other one."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Thing)

    __hash__ = None  # type: ignore[assignment]


def test_a_value_is_found_once_for_each_object() -> None:
    kept, found = Recent[int](2), list[int]()
    first, second, third = Thing(), Thing(), Thing()

    def find(number: int) -> int:
        found.append(number)
        return number

    for thing, number in ((first, 1), (second, 2), (first, 1), (third, 3), (second, 2), (first, 1)):
        assert kept.get(thing, lambda number=number: find(number)) == number  # type: ignore[misc]
    assert found == [1, 2, 3, 1]  # the oldest of three was dropped


def test_no_object_is_kept_alive() -> None:
    kept, thing = Recent[list[int]](4), Thing()
    assert kept.get(thing, lambda: [1]) is kept.get(thing, lambda: [2])
    gone = weakref.ref(thing)
    del thing
    gc.collect()
    assert gone() is None
    assert kept.get(Thing(), lambda: [3]) == [3]  # also where it has the place of the one that is gone
