"""A clock that was set back is noticed, one that gains or is set forward is not."""

import pytest

from mabirds_msgs_py.clock_watch import LEAST, PERIOD, SUSPENDED, SetBack


@pytest.mark.parametrize(
    ("step", "pause", "noticed"),
    [
        (0.0, PERIOD, False),
        (-86400.0, PERIOD, True),
        (-2 * LEAST, PERIOD, True),
        (-LEAST / 2, PERIOD, False),
        (86400.0, PERIOD, False),
        (0.0, 2 * SUSPENDED, True),
    ],
)
def test_a_step_back_and_a_process_that_stood_still(step: float, pause: float, noticed: bool) -> None:
    now, ahead = 100.0, 1e9
    clock = SetBack(lambda: now + ahead, lambda: now)
    now, ahead = now + pause, ahead + step
    assert clock.happened() == noticed
    now += PERIOD
    assert not clock.happened()
