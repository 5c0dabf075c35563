"""``mabirds play``: the player alone, with a keyboard and a bar."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Self

import rclpy
import typer
from rcl_interfaces.msg import Log
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from rich.live import Live

from mabirds_bringup.commands.options import ExperimentFile, Json
from mabirds_bringup.commands.player_options import takes_player_options
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_bringup.watch import player_view
from mabirds_bringup.watch.keyboard import Keyboard
from mabirds_core.texts import sanitize
from mabirds_expert_player.player_node import ExpertPlayerNode
from mabirds_msgs_py.clock_watch import SetBack, waking
from mabirds_msgs_py.conversion import NANOSECONDS
from mabirds_msgs_py.security import enclave_arguments, start_ros

LINE_PERIOD = 2.0
"""Seconds between two lines of progress where the output is no terminal."""

BAR_PERIOD = 0.1
"""Seconds between two pictures of the bar."""

LAST_WORDS = 0.2
"""Seconds in which the node's last lines come."""

SEEK_SECONDS = 10.0
FASTER, SLOWER = 1.1, 0.9
"""What keys do: as rosbag2's."""


@takes_player_options()
def play(
    file: ExperimentFile,
    player: dict[str, Any],
    run: Annotated[str, typer.Option(help="Name of the run that the learners take part in.")] = "",
    keyboard: Annotated[bool, typer.Option(help="Obey keys, where standard input is a terminal.")] = True,
    as_json: Json = False,
) -> None:
    """Play an experiment's bag to learners, or to whoever listens, until all of it is played.

    In a terminal: space pauses and resumes, right plays the next demonstration, up and down change the rate by a tenth,
    left and f go 10 s back and on, q stops.

    Example: mabirds play ros_ws/config/patrol.yaml --listeners --rate 10
    """
    arguments = ["--ros-args", *enclave_arguments("/expert_player"), "--disable-stdout-logs"]
    start_ros(arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with guarded_output() as stdout:
            values = {"experiment": str(file), "run": run, **player}
            node = ExpertPlayerNode(
                parameter_overrides=[Parameter(name, value=value) for name, value in values.items()]
            )
            _play(node, Keyboard() if keyboard else None)
            if as_json:
                print_json(player_view.content(node.status()), stdout)
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


def _play(node: ExpertPlayerNode, keyboard: Keyboard | None) -> None:
    """Until it is done, or Ctrl-C."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.create_subscription(Log, "/rosout", lambda entry: _show(node, entry), 100)
    picture = _Picture(node, keys=bool(keyboard and keyboard.is_there))
    with waking(executor, node, SetBack()), _keys(keyboard), picture:
        while not node.done:
            executor.spin_once(timeout_sec=BAR_PERIOD)
            for key in keyboard.pressed() if keyboard else ():
                _obey(node, key)
            picture.update()
        _hear_out(executor)
    console.print(player_view.line(node.status()), soft_wrap=True)


def _hear_out(executor: SingleThreadedExecutor) -> None:
    """What the node said last is still on its way through /rosout."""
    end = time.monotonic() + LAST_WORDS
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)


@contextmanager
def _keys(keyboard: Keyboard | None) -> Iterator[None]:
    if keyboard is None:
        yield
        return
    with keyboard:
        yield


def _show(node: ExpertPlayerNode, entry: Log) -> None:
    """The node's own log, above the bar."""
    if entry.name == node.get_logger().name:
        console.print(sanitize(entry.msg, 1000), soft_wrap=True)


def _obey(node: ExpertPlayerNode, key: str) -> None:
    """Do what a key asks for."""
    control, clock = node.control, node.playback.clock
    match key:
        case "space":
            control.set_paused(not clock.paused)
        case "right":
            control.step()
        case "up" | "down":
            control.set_rate(clock.rate * (FASTER if key == "up" else SLOWER))
        case "left" | "f":
            control.seek_by((-1 if key == "left" else 1) * round(SEEK_SECONDS * NANOSECONDS))
        case "q":
            control.stop()


class _Picture:
    """The bar on a terminal, a line every LINE_PERIOD seconds elsewhere."""

    def __init__(self, node: ExpertPlayerNode, *, keys: bool) -> None:
        self._node, self._keys, self._last = node, keys, 0.0
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None

    def __enter__(self) -> Self:
        if self._live:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def update(self) -> None:
        """Not more often than eyes can follow."""
        now = time.monotonic()
        if now - self._last < (BAR_PERIOD if self._live else LINE_PERIOD):
            return
        self._last = now
        if self._live:
            self._live.update(player_view.bar(self._node.status(), keys=self._keys), refresh=True)
        else:
            console.print(player_view.line(self._node.status()), soft_wrap=True)
