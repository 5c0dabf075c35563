"""What is left of a run, by its pace."""

from mabirds_bringup.watch.time_left import TimeLeft


def test_what_is_left_is_told_by_the_slowest_learner_since_the_first_look() -> None:
    now = 100.0
    left = TimeLeft(40, lambda: now)
    assert left.words([]) == ""
    assert left.words([4, 5]) == ""
    now += 1.0
    assert left.words([6, 9]) == ""  # too early
    now += 4.0
    assert left.words([14, 30]) == "about 13 s left"  # 26 of them at 10 in 5 s
    now += 595.0
    assert left.words([24, 30]) == "about 8 min left"
    assert left.words([40, 40]) == ""


def test_a_run_that_stands_says_nothing() -> None:
    now = 0.0
    left = TimeLeft(40, lambda: now)
    left.words([3])
    now = 60.0
    assert left.words([3]) == ""
