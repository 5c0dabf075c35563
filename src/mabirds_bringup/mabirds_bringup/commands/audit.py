"""``mabirds audit``: what a run reveals."""

import typer

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.options import Json
from mabirds_bringup.commands.report import RunDirectory
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.privacy.audit import audit
from mabirds_bringup.run.certificate import certify
from mabirds_bringup.run.stored_run import load_run
from mabirds_core.errors import ExperimentError

audit_app = typer.Typer(help="Find out what a run reveals.")


@audit_app.callback()
def _audit() -> None:
    """Keep ``privacy`` a command of its own although it is the only one."""


@audit_app.command()
def privacy(directory: RunDirectory, as_json: Json = False) -> None:
    """Rebuild private demonstrations from published theta and omega, and say how many steps were right.

    It uses what a neighbour has that sees all topics: parameters, the schedule and the experiment file. The bag serves
    only to compare. See docs/security.md.

    Example: mabirds audit privacy runs/latest
    """
    with guarded_output() as stdout:
        stored = load_run(directory.resolve())
        if stored.names != stored.experiment.learners:
            raise ExperimentError(f"{stored.directory}: a central method has all demonstrations; run learners")
        with stored.open_history() as kept:
            missing, history = certify(stored, kept).missing, kept.without_gap()
        if missing:
            raise ExperimentError(f"{stored.directory}: {missing[0]}; go on with `mabirds run --resume` first")
        demonstrations = demonstrations_of(stored.experiment, stored.plan.bags)
        found = audit(stored.experiment, history, demonstrations, lambda name: console.print(f"attacking {name}"))
        for name, revealed in found.items():
            console.print(
                f"{name}: {revealed.steps:.1%} of the steps rebuilt, {revealed.whole} of {revealed.demonstrations}"
                " demonstrations in every step",
                soft_wrap=True,
            )
        if as_json:
            print_json({name: revealed._asdict() for name, revealed in found.items()}, stdout)
