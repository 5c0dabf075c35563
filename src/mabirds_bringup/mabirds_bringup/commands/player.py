"""``mabirds player``: control a running player."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import rclpy
import typer
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.watch import player_view
from mabirds_bringup.watch.player_client import PlayerClient
from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.conversion import NANOSECONDS, nanoseconds, time_message
from mabirds_msgs_py.security import enclave_arguments, start_ros

player_app = typer.Typer(help="Control a running player: that of `mabirds play`, of `mabirds run`, or a node by hand.")

Player = Annotated[str, typer.Option(help="Full name of the player.")]
Timeout = Annotated[float, typer.Option(help="Seconds to find it, and for its answer.", min=0.1)]

DEFAULT_PLAYER = "/expert_player"
DEFAULT_TIMEOUT = 15.0


class RefusedError(MabirdsError):
    """The player did not do what was asked for."""


@contextmanager
def _client(player: str, timeout: float) -> Iterator[tuple[PlayerClient, Any]]:
    """One who asks, and where programs read."""
    fleet, _, _ = player.rpartition("/")
    arguments = ["--ros-args", *enclave_arguments(f"{fleet}/player_client")]
    start_ros(arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with guarded_output() as stdout:
            client = PlayerClient(player, timeout, namespace=fleet or "/")
            yield client, stdout
            client.destroy_node()
    finally:
        rclpy.try_shutdown()


def _ask(name: str, player: str, timeout: float, *, as_json: bool, **fields: Any) -> None:
    """Call a service and tell what it said; a request that was not fulfilled is an error."""
    with _client(player, timeout) as (client, stdout):
        response, reason = client.ask(name, **fields)
        _tell(client, reason, stdout, as_json=as_json, fulfilled=_is_fulfilled(response, fields))


def _is_fulfilled(response: Any, fields: dict[str, Any]) -> bool:
    if hasattr(response, "actually_burst"):
        return bool(response.actually_burst >= fields["num_messages"])
    return bool(getattr(response, "success", True))


def _tell(client: PlayerClient, reason: str, stdout: Any, *, as_json: bool, fulfilled: bool) -> None:
    if as_json:
        print_json({"fulfilled": fulfilled, **player_view.content(client.find())}, stdout)
    if not fulfilled:
        raise RefusedError(reason or "the player refused and gave no reason; look at its log")
    console.print(reason or "done", soft_wrap=True)


@player_app.command()
def status(player: Player = DEFAULT_PLAYER, timeout: Timeout = DEFAULT_TIMEOUT, as_json: Json = False) -> None:
    """Tell where a player is, how fast it plays, and for what it waits.

    Example: mabirds player status --json
    """
    with _client(player, timeout) as (client, stdout):
        found = client.find()
        console.print(player_view.line(found), soft_wrap=True)
        if as_json:
            print_json(player_view.content(found), stdout)


@player_app.command()
def pause(player: Player = DEFAULT_PLAYER, timeout: Timeout = DEFAULT_TIMEOUT, as_json: Json = False) -> None:
    """Pause: nothing is sent until it is resumed.

    Example: mabirds player pause
    """
    _ask("pause", player, timeout, as_json=as_json)


@player_app.command()
def resume(player: Player = DEFAULT_PLAYER, timeout: Timeout = DEFAULT_TIMEOUT, as_json: Json = False) -> None:
    """Go on from where it was paused.

    Example: mabirds player resume
    """
    _ask("resume", player, timeout, as_json=as_json)


@player_app.command()
def rate(
    value: Annotated[float, typer.Argument(metavar="RATE", help="Speed, as a multiple of the recorded timing.")],
    player: Player = DEFAULT_PLAYER,
    timeout: Timeout = DEFAULT_TIMEOUT,
    as_json: Json = False,
) -> None:
    """Play at another rate, at once.

    Example: mabirds player rate 10
    """
    _ask("set_rate", player, timeout, as_json=as_json, rate=value)


@player_app.command(name="next")
def next_(
    count: Annotated[int, typer.Argument(metavar="COUNT", help="How many demonstrations.", min=1)] = 1,
    player: Player = DEFAULT_PLAYER,
    timeout: Timeout = DEFAULT_TIMEOUT,
    as_json: Json = False,
) -> None:
    """While paused, publish the next demonstrations in recorded order, as learners take them.

    Example: mabirds player next 5
    """
    _ask("burst", player, timeout, as_json=as_json, num_messages=count)


@player_app.command()
def seek(
    seconds: Annotated[float, typer.Argument(metavar="SECONDS", help="Recorded seconds after the beginning.")],
    player: Player = DEFAULT_PLAYER,
    timeout: Timeout = DEFAULT_TIMEOUT,
    as_json: Json = False,
) -> None:
    """Go on elsewhere in the recording; not back to what a learner was given, which cannot be taken back.

    Example: mabirds player seek 30
    """
    with _client(player, timeout) as (client, stdout):
        moment = nanoseconds(client.find().first) + round(seconds * NANOSECONDS)
        response, reason = client.ask("seek", time=time_message(moment))
        _tell(client, reason, stdout, as_json=as_json, fulfilled=response.success)


@player_app.command()
def stop(player: Player = DEFAULT_PLAYER, timeout: Timeout = DEFAULT_TIMEOUT, as_json: Json = False) -> None:
    """End playing.

    Example: mabirds player stop
    """
    _ask("stop", player, timeout, as_json=as_json)
