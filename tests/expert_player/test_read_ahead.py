"""Reading ahead changes when a demonstration is read, and not which."""

from pathlib import Path

import pytest

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_expert_player.read_ahead import AT_ONCE, ReadAhead
from mabirds_msgs_py.bag_reader import DemonstrationBag


class Counting(DemonstrationBag):
    """A bag that tells what was read."""

    def __init__(self, directory: Path, experiment: Experiment) -> None:
        super().__init__(directory, build_game(experiment), experiment.learners)
        self.read: list[int] = []

    def message(self, learner: str, iteration: int) -> object:  # type: ignore[override]
        self.read.append(iteration)
        return super().message(learner, iteration)


@pytest.mark.parametrize("depth", [1, 2, 100])
def test_what_follows_is_read_before_it_is_asked_for(experiment: Experiment, depth: int) -> None:
    with Counting(experiment.demonstrations.bag, experiment) as bag:
        ahead = ReadAhead(bag, "learner_1", depth)
        assert ahead.fill(0, 6)
        assert bag.read == list(range(1, min(depth, 6, AT_ONCE) + 1))
        bag.read.clear()
        assert ahead.take(1).iteration == 1
        assert bag.read == []
        assert ahead.take(5).iteration == 5
        assert ahead.take(2).iteration == 2
        assert [ahead.take(n).iteration for n in range(1, 7)] == list(range(1, 7))


def test_no_more_is_read_than_there_is_and_may_be_kept(experiment: Experiment) -> None:
    with Counting(experiment.demonstrations.bag, experiment) as bag:
        ahead = ReadAhead(bag, "learner_2", 3)
        while ahead.fill(2, 6):
            pass
        assert bag.read == [3, 4, 5]
        while ahead.fill(4, 6):
            pass
        assert bag.read == [3, 4, 5, 6]
