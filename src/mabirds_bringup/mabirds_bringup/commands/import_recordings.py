"""``mabirds import``: from recordings of several agents to a bag of demonstrations and an experiment file."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json, progress_bar
from mabirds_bringup.importing.importer import Import, import_tracks
from mabirds_bringup.importing.rules import ImportRules, load_rules
from mabirds_bringup.importing.tracks import Track
from mabirds_core.extras import require
from mabirds_core.texts import sanitize


def import_recordings(
    recordings: Annotated[
        list[Path], typer.Argument(metavar="RECORDING...", help="Bags (any that rosbags reads), or CSV files.")
    ],
    rules: Annotated[Path, typer.Option(help="YAML file: who is an expert, the area, how recordings are cut.")],
    out: Annotated[Path, typer.Option(help="Directory for the bag, the experiment file and the report.")],
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Tell what would be kept, and write nothing.")] = False,
    as_json: Json = False,
) -> None:
    """Make demonstrations and an experiment file of your own recordings, and tell what was kept and dropped, and why.

    Example: mabirds import recordings/* --rules rules.yaml --out mine
    """
    require("rosbags", "reading recordings", "mabirds_bringup[import]")
    with guarded_output() as stdout:
        settings = load_rules(rules)
        result = import_tracks(read_all(recordings, settings), settings, str(rules))
        tell(result)
        if not dry_run:
            write(out, result)
        if as_json:
            print_json({"out": None if dry_run else str(out), **result.content()}, stdout)


def read_all(recordings: Sequence[Path], rules: ImportRules) -> Iterator[Track]:
    """Tracks of all recordings, with a bar of progress."""
    from mabirds_bringup.importing.reading import read_recording

    with progress_bar() as bar:
        task = bar.add_task("reading", total=len(recordings))
        for recording in recordings:
            yield from read_recording(recording, rules)
            bar.advance(task)


def write(out: Path, result: Import) -> None:
    """Fill the directory, and say how to go on."""
    from mabirds_bringup.importing.output import EXPERIMENT, HELD_OUT, REPORT, write_import  # matplotlib takes a second

    write_import(out, result)
    console.print(f"wrote {out}: see {REPORT}; learn it: mabirds simulate {out / EXPERIMENT}", soft_wrap=True)
    if result.held_out:
        console.print(f"then judge it: mabirds evaluate runs/latest --bag {out / HELD_OUT}", soft_wrap=True)


def tell(result: Import) -> None:
    """What was kept and dropped, for people."""
    told: dict[str, Any] = result.content()
    for what, count in sorted(result.findings.items()):
        console.print(f"{sanitize(what, 300)}: {count}", style="yellow", soft_wrap=True)
    kept = ", ".join(f"{name} {count}" for name, count in told["demonstrations"].items())
    console.print(
        f"demonstrations: {kept}; held out {told['held_out']}; horizon {told['horizon']} steps; residual mean"
        f" {told['residual_mean']:.4f} m, largest {told['residual_max']:.4f} m",
        soft_wrap=True,
    )
