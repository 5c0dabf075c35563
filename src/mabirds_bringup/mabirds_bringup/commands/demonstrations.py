"""The demonstrations of an experiment, for commands: whether they are at hand, and which they are."""

from collections.abc import Sequence
from pathlib import Path

from mabirds_bringup.console import console
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_msgs_py.bag_digest import bag_digest
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError


def digest_at_hand(experiment: Experiment, file: Path, bags: Sequence[Path] = (), *, needed: bool) -> str | None:
    """Digest of the demonstrations; None where a bag is not on this host. Raises BagError where it is ``needed``.

    ``bags``: in the place of the experiment's own.
    """
    bags = bags or [experiment.demonstrations.bag]
    if absent := [bag for bag in bags if not bag.exists()]:
        if needed:
            raise BagError(f"{absent[0]}: there is no bag; record it: mabirds record {file}")
        return None
    game = build_game(experiment)
    with DemonstrationBag(bags, game, experiment.learners, at_least=experiment.iterations) as bag:
        return bag_digest(bag, experiment.learners, experiment.iterations)


def demonstrations_of(experiment: Experiment, bags: Sequence[Path] = ()) -> Streams:
    """Each learner's demonstrations, from these bags or the experiment's own."""
    with DemonstrationBag(bags or experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: list(bag.trajectories(name)) for name in experiment.learners}


def demonstrations_at_hand(experiment: Experiment, bags: Sequence[Path] = ()) -> Streams:
    """The demonstrations that learners had, for the test of constraints; none on a host without the bags."""
    bags = bags or [experiment.demonstrations.bag]
    if all(bag.exists() for bag in bags):
        return demonstrations_of(experiment, bags)
    console.print(
        f"{', '.join(map(str, bags))} is not on this host: constraints are told by the threshold on -omega",
        soft_wrap=True,
    )
    return {}
