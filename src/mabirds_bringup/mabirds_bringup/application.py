"""The ``mabirds`` application: one file per verb in ``mabirds_bringup.commands``."""

import sys

import typer
from typer.exceptions import TyperException

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.audit import audit_app
from mabirds_bringup.commands.bag import bag_app
from mabirds_bringup.commands.bench import bench_app
from mabirds_bringup.commands.inspect import inspect
from mabirds_bringup.commands.kinds import kinds
from mabirds_bringup.commands.members import members
from mabirds_bringup.commands.play import play
from mabirds_bringup.commands.player import player_app
from mabirds_bringup.commands.record import record
from mabirds_bringup.commands.report import check, report
from mabirds_bringup.commands.run import run
from mabirds_bringup.commands.schedule import schedule_app
from mabirds_bringup.commands.security import security_app
from mabirds_bringup.commands.simulate import simulate
from mabirds_bringup.console import console
from mabirds_bringup.run.supervisor import ProcessDiedError
from mabirds_bringup.watch.player_client import NoPlayerError
from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.environment import prepare_environment

app = typer.Typer(
    pretty_exceptions_enable=False,
    help="Learn what several agents want and what they may not do, from demonstrations that learners never pool.\n\n"
    "Exit codes: 0 finished, 2 bad input, 3 a process died, 4 no learner or player found, 5 incomplete,"
    " 130 interrupted.",
)
for verb in (run, simulate, play, report, check, record, inspect, members, kinds):
    app.command()(verb)
app.add_typer(audit_app, name="audit")
app.add_typer(bag_app, name="bag")
app.add_typer(bench_app, name="bench")
app.add_typer(player_app, name="player")
app.add_typer(schedule_app, name="schedule")
app.add_typer(security_app, name="security")


def main() -> None:
    """Entry point of ``mabirds``: errors are one message and an exit code, never a traceback."""
    prepare_environment()
    try:
        code = app(standalone_mode=False) or exit_codes.FINISHED
    except ProcessDiedError as error:
        _fail(str(error), exit_codes.PROCESS_DIED)
    except NoPlayerError as error:
        _fail(str(error), exit_codes.NOBODY_THERE)
    except MabirdsError as error:
        _fail(str(error), exit_codes.BAD_INPUT)
    except OSError as error:
        place = error.filename or "the output"
        _fail(f"{place}: {error.strerror}; choose a place that can be read and written", exit_codes.BAD_INPUT)
    except TyperException as error:
        _fail(f"{error.format_message()} (see --help)", exit_codes.BAD_INPUT)
    if code == exit_codes.INTERRUPTED:
        _fail("interrupted; everything was stopped", code)
    sys.exit(code)


def _fail(message: str, code: int) -> None:
    console.print(f"error: {message}", style="red", soft_wrap=True)
    sys.exit(code)
