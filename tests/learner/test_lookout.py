"""A learner says who should not be there, and that nobody is."""

import pytest

from mabirds_learner import lookout
from mabirds_learner.lookout import Lookout, Sight

USUAL = Sight(players=1, namesakes=1, others=2)


def said(*sights: Sight) -> list[str]:
    words, left = list[str](), list(sights)
    watch = Lookout("learner_1", lambda: left.pop(0), words.append)
    for _ in sights:
        watch.on_timer()
    return words


def test_nothing_is_said_of_what_is_usual_or_over_at_once() -> None:
    assert said(*[USUAL] * 10) == []
    assert said(USUAL, *[Sight(2, 1, 3)] * 2, *[USUAL] * 4) == []


@pytest.mark.parametrize(
    ("sight", "words"),
    [
        (Sight(2, 1, 3), "a second expert_player plays to learner_1"),
        (Sight(1, 3, 3), "3 processes of this run are learner_1; end all but one"),
    ],
)
def test_what_lasts_is_said_once_and_again_after_it_was_over(sight: Sight, words: str) -> None:
    (only,) = said(*[sight] * 8)
    assert words in only
    assert len(said(*[sight] * 4, *[USUAL] * 4, *[sight] * 4)) == 2


def test_who_hears_nobody_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lookout, "ALONE", -1.0)
    monkeypatch.setenv("ROS_DOMAIN_ID", "11")
    (words,) = said(*[Sight(0, 1, 0)] * 8)
    assert "nobody heard in ROS domain 11" in words
    monkeypatch.setattr(lookout, "ALONE", 60.0)
    assert said(*[Sight(0, 1, 0)] * 8) == []
