"""``mabirds bag``: look at bags, check them, save what is intact of damaged ones."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.texts import sanitize
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.bag_repair import repair as repair_bag
from mabirds_msgs_py.bag_survey import BagSurvey, DemonstrationTopic, survey
from mabirds_msgs_py.conversion import NANOSECONDS
from mabirds_msgs_py.errors import BagError

bag_app = typer.Typer(help="Look at bags of demonstrations, check them, repair them.")

EXPERIMENT_SUFFIXES = (".yaml", ".yml")

Bag = Annotated[Path, typer.Argument(metavar="BAG", help="Directory of a bag, or an .mcap file.")]


@bag_app.command()
def info(bag: Bag, as_json: Json = False) -> None:
    """Tell what a bag holds: files, topics, demonstrations by learner.

    Example: mabirds bag info bags/mine
    """
    with guarded_output() as stdout:
        found = survey(bag)
        _show(found)
        if as_json:
            print_json(_content(bag, found), stdout)


@bag_app.command()
def check(
    bag: Annotated[
        Path, typer.Argument(metavar="BAG", help="Directory of a bag, an .mcap file, or an experiment file: its bag.")
    ],
    experiment: Annotated[
        Path | None, typer.Option(help="Experiment file: learners, game and transitions are checked as well.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Check a bag: checksums where demonstrations are, iteration numbers; with an experiment, every transition too.

    Example: mabirds bag check bags/mine --experiment ros_ws/config/patrol.yaml
    """
    with guarded_output() as stdout:
        if bag.suffix in EXPERIMENT_SUFFIXES and bag.is_file():
            bag, experiment = load_experiment(bag).demonstrations.bag, bag
        found = survey(bag)
        if faults := found.faults():
            raise BagError(f"{bag}: {'; '.join(faults)}; record it anew, or save the rest by `mabirds bag repair`")
        if experiment:
            _check_transitions(bag, experiment)
        counts = {topic: len(content.iterations) for topic, content in found.demonstrations.items()}
        words = ", ".join(f"{sanitize(topic)} {count}" for topic, count in counts.items())
        console.print(f"{bag}: whole; {words}", soft_wrap=True)
        if as_json:
            print_json(_content(bag, found), stdout)


@bag_app.command()
def repair(
    bag: Bag,
    target: Annotated[Path, typer.Argument(metavar="TARGET", help="Directory of the new bag.")],
    as_json: Json = False,
) -> None:
    """Write what is intact of a bag to a new one: demonstrations up to the first that is lost, other topics whole.

    Example: mabirds bag repair bags/killed bags/saved
    """
    with guarded_output() as stdout:
        result = repair_bag(bag, target)
        for words in result.damage:
            console.print(sanitize(words), style="yellow", soft_wrap=True)
        for topic, count in sorted(result.kept.items()):
            left_out = result.left_out[topic]
            tail = f", left out {left_out} after a lost one or again" if left_out else ""
            console.print(f"{sanitize(topic)}: kept {count}{tail}", soft_wrap=True)
        if as_json:
            content = {"kept": result.kept, "left_out": result.left_out, "damage": result.damage}
            print_json({"bag": str(target), **content}, stdout)


def _check_transitions(bag: Path, file: Path) -> None:
    experiment = load_experiment(file)
    with DemonstrationBag(bag, build_game(experiment), experiment.learners) as reader:
        for name in experiment.learners:
            for _ in reader.trajectories(name):
                pass


def _show(found: BagSurvey) -> None:
    for file in found.files:
        console.print(f"{file} ({file.stat().st_size} bytes)", soft_wrap=True)
    for topic, count in sorted(found.counts.items()):
        content = found.demonstrations.get(topic)
        words = f": {_words(content)}" if content else ""
        console.print(f"{sanitize(topic)}, {count} messages{words}", soft_wrap=True)


def _words(content: DemonstrationTopic) -> str:
    first, last = content.times
    learners = ", ".join(map(sanitize, sorted(content.learners)))
    games = ", ".join(sanitize(game, 20) for game in sorted(content.games))
    faults = "".join(f"; {fault}" for fault in content.faults())
    return (
        f"demonstrations 1 to {content.intact} of {learners} in {(last - first) / NANOSECONDS:g} s, repeated"
        f" {content.repeated}, game {games}{faults}"
    )


def _content(bag: Path, found: BagSurvey) -> dict[str, Any]:
    demonstrations = {
        topic: {
            "learners": sorted(content.learners),
            "games": sorted(content.games),
            "demonstrations": content.intact,
            "repeated": content.repeated,
            "first": content.times[0],
            "last": content.times[1],
        }
        for topic, content in found.demonstrations.items()
    }
    files = [str(file) for file in found.files]
    counts = {learner: topic.intact for topic in found.demonstrations.values() for learner in sorted(topic.learners)}
    return {
        "bag": str(bag),
        "files": files,
        "demonstrations": counts,
        "messages": found.counts,
        "topics": demonstrations,
    }
