"""``mabirds dashboard``: a live page of a running network."""

import secrets
from contextlib import suppress
from typing import Annotated

import typer

from mabirds_bringup import exit_codes
from mabirds_bringup.commands.options import ExperimentFile
from mabirds_bringup.console import console, ending_as_interrupted, guarded_output
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment

LOOPBACK = "127.0.0.1"


def dashboard(
    file: ExperimentFile,
    host: Annotated[str, typer.Option(help="Address to serve; 0.0.0.0: all of this host.")] = LOOPBACK,
    port: Annotated[int, typer.Option(help="Port to serve.", min=1, max=65535)] = 8080,
    key: Annotated[str, typer.Option(help="Who has it may control the player; empty: a new one.")] = "",
) -> int:
    """Serve a live page of a running network, until Ctrl-C: graph, curves, maps, and the player's controls.

    It loads nothing from elsewhere. Who opens it without the key may look, and nothing else.

    Example: mabirds dashboard ros_ws/config/patrol.yaml
    """
    try:
        from mabirds_bringup.dashboard.serving import serve
    except ImportError as error:
        raise ExperimentError(f"the page needs {error.name}; install mabirds_bringup[dashboard]") from None
    experiment, key = load_experiment(file), key or secrets.token_urlsafe(12)
    with guarded_output(), ending_as_interrupted(), suppress(KeyboardInterrupt):
        console.print(f"to look:    http://{host}:{port}/", soft_wrap=True)
        console.print(f"to control: http://{host}:{port}/?key={key}", soft_wrap=True)
        serve(experiment, host, port, key)
    return exit_codes.FINISHED
