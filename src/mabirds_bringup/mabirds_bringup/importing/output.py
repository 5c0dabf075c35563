"""What an import leaves behind: bags, the experiment file, a report and a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from mabirds_bringup.importing.fitting import Demonstrated
from mabirds_bringup.importing.importer import Import
from mabirds_bringup.importing.picture import import_figure
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import without_defaults
from mabirds_expert_player.recorder import FIRST_STAMP
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import NANOSECONDS, demonstration_message
from mabirds_msgs_py.topics import bag_topic

BAG, HELD_OUT, EXPERIMENT, REPORT, PICTURE = "bag", "held_out", "experiment.yaml", "import.md", "import.png"


def write_import(directory: Path, result: Import) -> None:
    """Fill a directory.

    Parameters
    ----------
    directory : Path
        Is made, or may be empty of what is written.
    result : Import
        Of the recordings.

    Raises
    ------
    BagError
        There is a bag already.
    """
    directory.mkdir(parents=True, exist_ok=True)
    _write_bag(directory / BAG, result, {name: list(stream) for name, stream in result.learned.items()})
    if result.held_out:
        streams = _dealt(result.held_out, list(result.learned))
        _write_bag(directory / HELD_OUT, result, streams)
    content = _experiment(result)
    (directory / EXPERIMENT).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    (directory / REPORT).write_text(report(result), encoding="utf-8")
    import_figure(result).savefig(directory / PICTURE, dpi=110)


def _experiment(result: Import) -> dict[str, Any]:
    content = without_defaults(result.experiment)
    content["demonstrations"]["bag"] = BAG
    return content


def _dealt(demonstrated: Sequence[Demonstrated], learners: Sequence[str]) -> dict[str, list[Demonstrated]]:
    """In turn; who sees which does not matter, as nobody learns from them."""
    return {name: list(demonstrated[number :: len(learners)]) for number, name in enumerate(learners)}


def _write_bag(directory: Path, result: Import, streams: dict[str, list[Demonstrated]]) -> None:
    """Every learner's demonstrations, as many passes as its iterations make."""
    game, settings = build_game(result.experiment), result.experiment.demonstrations
    passes = settings.per_learner // max(1, len(next(iter(result.learned.values())))) if directory.name == BAG else 1
    with BagWriter(directory) as bag:
        for name, stream in streams.items():
            for iteration, of in enumerate(stream * passes, start=1):
                stamp = FIRST_STAMP + round((iteration - 1) * settings.period * NANOSECONDS)
                message = demonstration_message(game, name, iteration, of.trajectory, stamp)
                bag.write(bag_topic(name), message, stamp)


def report(result: Import) -> str:
    """What was kept and dropped, and why, as Markdown.

    Parameters
    ----------
    result : Import
        Of the recordings.

    Returns
    -------
    str
        With a table.
    """
    told = result.content()
    kept = ", ".join(f"{name} {count}" for name, count in told["demonstrations"].items())
    lines = [
        f"# Import {result.experiment.name}",
        "",
        f"Demonstrations: {kept}; held out {told['held_out']}.",
        f"Horizon: {told['horizon']} steps of {result.experiment.game.time_step:g} s.",
        "",
        "Residual between recorded places and demonstrations:",
        f"mean {told['residual_mean']:.4f} m, 95 % below {told['residual_95']:.4f} m,",
        f"largest {told['residual_max']:.4f} m.",
        "",
        "| found | count |",
        "|---|---|",
        *(f"| {what} | {count} |" for what, count in sorted(result.findings.items())),
        "",
        f"![What was imported]({PICTURE})",
        "",
    ]
    return "\n".join(lines)
