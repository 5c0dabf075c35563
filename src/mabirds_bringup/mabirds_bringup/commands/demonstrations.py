"""The demonstrations of an experiment, for commands: whether they are at hand, and which they are."""

from pathlib import Path

from mabirds_bringup.console import console
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_msgs_py.bag_digest import bag_digest
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError


def digest_at_hand(experiment: Experiment, file: Path, *, needed: bool) -> str | None:
    """Digest of the demonstrations; None where the bag is not on this host. Raises BagError where it is ``needed``."""
    directory = experiment.demonstrations.bag
    if not directory.exists():
        if needed:
            raise BagError(f"{directory}: there is no bag; record it: mabirds record {file}")
        return None
    game = build_game(experiment)
    with DemonstrationBag(directory, game, experiment.learners, at_least=experiment.iterations) as bag:
        return bag_digest(bag, experiment.learners, experiment.iterations)


def demonstrations_of(experiment: Experiment) -> Streams:
    """Each learner's demonstrations, from the experiment's own bag."""
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: list(bag.trajectories(name)) for name in experiment.learners}


def demonstrations_at_hand(experiment: Experiment) -> Streams:
    """The demonstrations that learners had, for the test of constraints; none on a host without the bag."""
    bag = experiment.demonstrations.bag
    if bag.exists():
        return demonstrations_of(experiment)
    console.print(f"{bag} is not on this host: constraints are told by the threshold on -omega", soft_wrap=True)
    return {}
