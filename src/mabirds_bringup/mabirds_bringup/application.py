"""The ``mabirds`` application: one file per verb in ``mabirds_bringup.commands``."""

import sys

import typer
from typer.exceptions import TyperException

from mabirds_bringup import exit_codes
from mabirds_bringup.console import console
from mabirds_bringup.verbs import Verbs
from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.environment import prepare_environment

app = typer.Typer(
    cls=Verbs,
    pretty_exceptions_enable=False,
    help="Learn what several agents want and what they may not do, from demonstrations that learners never pool.\n\n"
    "Exit codes: 0 finished, 2 bad input, 3 a process died, 4 no learner or player found, 5 incomplete,"
    " 130 interrupted.",
)


@app.callback()
def _verbs() -> None:
    """Nothing that all verbs have in common."""


def main() -> None:
    """Entry point of ``mabirds``: errors are one message and an exit code, never a traceback."""
    prepare_environment()
    try:
        code = app(standalone_mode=False) or exit_codes.FINISHED
    except MabirdsError as error:
        _fail(str(error), getattr(error, "exit_code", exit_codes.BAD_INPUT))
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
