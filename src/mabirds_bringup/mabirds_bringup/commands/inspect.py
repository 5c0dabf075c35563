"""``mabirds inspect``: what the learners and players of this domain say. Data on standard output, talk on the other."""

import time
from contextlib import closing, suppress
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.live import Live

from mabirds_bringup import exit_codes
from mabirds_bringup.commands import inspect_topics
from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, ending_as_interrupted, guarded_output, print_json
from mabirds_bringup.priority import step_back
from mabirds_bringup.watch.described import describe, describe_parameters
from mabirds_bringup.watch.drawn_costs import CostsInspectorNode
from mabirds_bringup.watch.inspector import InspectorNode, WatchedLearner
from mabirds_bringup.watch.overview import overview
from mabirds_bringup.watch.player_view import content as player_content
from mabirds_bringup.watch.recent import RecentParameters
from mabirds_bringup.watch.spinning import NICE, Glances, looking
from mabirds_core.errors import ExperimentError
from mabirds_core.texts import sanitize
from mabirds_learner.learner_session import DEMONSTRATION
from mabirds_msgs_py.constraints_conversion import constraints_text

MAX_LINE = 1000
"""Characters of what is shown of a message."""

inspect_app = typer.Typer(invoke_without_command=True, add_completion=False)
for verb, function in (
    ("list", inspect_topics.list_),
    ("echo", inspect_topics.echo),
    ("hz", inspect_topics.hz),
    ("bw", inspect_topics.bw),
    ("info", inspect_topics.info),
    ("call", inspect_topics.call),
):
    inspect_app.command(verb)(function)
inspect_app.add_typer(inspect_topics.param_app, name="param")


@inspect_app.callback()
def inspect(
    context: typer.Context,
    once: Annotated[bool, typer.Option("--once", help="Show every learner once, then end.")] = False,
    top: Annotated[int, typer.Option(help="How many costs and constraints to name.", min=0)] = 3,
    timeout: Annotated[float, typer.Option(help="Seconds to look for learners, with --once.", min=0.1)] = 10.0,
    lines: Annotated[bool, typer.Option("--lines", help="A line for each message, in a terminal too.")] = False,
    as_json: Json = False,
) -> None:
    """Show the learners and players of this ROS domain.

    On a terminal it is a table that follows them; elsewhere a line for each of their messages. The verbs below look at
    any topic, parameter and service.

    Example: mabirds inspect --once --json
    """
    if context.invoked_subcommand is not None:
        return
    if as_json and not once:
        raise ExperimentError("--json prints one object and needs --once")
    step_back(NICE)
    with suppress(BrokenPipeError), guarded_output() as stdout, ending_as_interrupted():
        if once:
            code = _inspect_once(top, timeout, stdout, as_json=as_json)
        else:
            with suppress(KeyboardInterrupt):
                _follow(top, stdout, lines=lines)
            code = exit_codes.FINISHED
        raise typer.Exit(code)


def _follow(top: int, stdout: Any, *, lines: bool) -> None:
    """Until Ctrl-C."""
    console.print("looking for learners; Ctrl-C ends")
    if stdout.isatty() and not lines:
        _follow_in_a_table(Console(file=stdout, markup=False, highlight=False))
    else:
        _follow_by_lines(top, stdout)


def _follow_in_a_table(screen: Console) -> None:
    recent = RecentParameters()

    def on_message(learner: WatchedLearner, what: str) -> None:
        if what == "parameters":
            recent.note(learner.namespace, learner.parameters)

    with looking(lambda: CostsInspectorNode(on_message), "/inspector") as (node, executor):
        glances, shown = Glances(node, executor), 0.0
        with closing(glances), Live(console=screen, auto_refresh=False) as live:
            while True:
                glances.glance()
                if time.monotonic() - shown > 0.25:
                    shown = time.monotonic()
                    heard = {topic: grid for topic, grid in node.maps.items() if grid is not None}
                    live.update(overview(node, recent, heard), refresh=True)


def _follow_by_lines(top: int, stdout: Any) -> None:
    """Print as messages come."""
    shown: dict[str, str] = {}

    def on_message(learner: WatchedLearner, what: str) -> None:
        if what == "parameters":
            line = _parameters_line(describe_parameters(learner, top))
        elif what == "status":
            line = _status_line(describe(learner, top))
        elif what == "constraints":
            line = constraints_text(learner.constraints, top)
        else:
            return
        if what != "status" or shown.get(learner.namespace) != line:
            _print(f"{learner.namespace} {line}", stdout)
        if what == "status":
            shown[learner.namespace] = line

    with looking(lambda: InspectorNode(on_message), "/inspector") as (_, executor):
        executor.spin()


def _inspect_once(top: int, timeout: float, stdout: Any, *, as_json: bool) -> int:
    """Wait until the newest of all learners is heard, at most ``timeout`` seconds, and show them."""
    with looking(InspectorNode, "/inspector") as (node, executor):
        deadline = time.monotonic() + timeout
        while not node.complete and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.1)
        learners, missing = dict(sorted(node.learners.items())), node.missing()
        players = {topic: player_content(status) for topic, status in node.players.items() if status is not None}
    if as_json:
        content = {name: describe(learner, top) for name, learner in learners.items()}
        print_json({"learners": content, "missing": missing, "players": players}, stdout)
    else:
        _show(learners, top, stdout)
    if missing:
        console.print(f"not found, but in the schedule: {', '.join(map(sanitize, missing))}", soft_wrap=True)
    if not learners:
        console.print("no learner found; start some, and compare ROS_DOMAIN_ID here and there", soft_wrap=True)
    return exit_codes.FINISHED if learners else exit_codes.NOBODY_THERE


def _show(learners: dict[str, WatchedLearner], top: int, stdout: Any) -> None:
    for namespace, learner in learners.items():
        content = describe(learner, top)
        if "state" in content:
            _print(f"{namespace} {_status_line(content)}", stdout)
        if "parameters" in content:
            _print(f"{namespace} {_parameters_line(content['parameters'])}", stdout)
        if "constraints" in content:
            _print(f"{namespace} {constraints_text(learner.constraints, top)}", stdout)
        if "refused" in content:
            _print(f"{namespace} refused, since it cannot be shown: {content['refused']}", stdout)


def _print(line: str, stdout: Any) -> None:
    """One line, whatever others have put into their messages."""
    print(sanitize(line, MAX_LINE), file=stdout, flush=True)


def _status_line(content: dict[str, Any]) -> str:
    neighbours = [name for name in content["waiting_for"] if name != DEMONSTRATION]
    waiting = f" ({', '.join(neighbours)})" if neighbours else ""
    dropped = f", dropped {content['dropped']}" if content["dropped"] else ""
    message = f", {content['message']}" if content["message"] else ""
    return (
        f"iteration {content['iteration']}: {content['state']}{waiting}, backlog {content['backlog']}{dropped}{message}"
    )


def _parameters_line(content: dict[str, Any]) -> str:
    costliest = ", ".join(f"{cost['feature']} {cost['cost']:.3g}" for cost in content["costliest"])
    return (
        f"parameters {content['iteration']}: |theta| {content['theta_norm']:.4g}, |omega| {content['omega_norm']:.4g},"
        f" costliest: {costliest or 'omega is a network'}"
    )
