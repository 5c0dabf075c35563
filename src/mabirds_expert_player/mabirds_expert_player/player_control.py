"""What people ask of the player: rosbag2's eleven services, each answered truthfully and with a reason.

rosbag2's answers have no room for a reason: it goes to the log and to the player's status.
"""

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from mabirds_core.errors import MabirdsError
from mabirds_expert_player.playback import Part, Playback, seconds
from mabirds_msgs_py.conversion import nanoseconds
from mabirds_msgs_py.player_services import PLAYER_SERVICES, service_type

STEP_PATIENCE = 10.0
"""Seconds without any demonstration published after which a step that waits for learners is answered."""

STEPS = ("play_next", "burst")
"""Services that answer once learners have taken what was asked for."""


class PlayerControl:
    """Serves the services of a player, and does what the keyboard asks for.

    Parameters
    ----------
    node : Node
        The player, with a parameter ``rate``.
    playback : Playback
        What it plays.
    wake : Callable[[], None]
        Looks at what is due.
    tell : Callable[[str], None]
        Tells people what was done.
    """

    def __init__(self, node: Node, playback: Playback, wake: Callable[[], None], tell: Callable[[str], None]) -> None:
        self._node, self._playback, self._wake, self._tell = node, playback, wake, tell
        self._step: Future | None = None
        self._step_deadline, self._step_owed = 0.0, 0
        while_waiting = ReentrantCallbackGroup()  # else nobody else would be served while a step waits for learners
        for name in PLAYER_SERVICES:
            handler = getattr(self, f"_on_{name}")
            group = while_waiting if name in STEPS else None
            node.create_service(service_type(name), f"~/{name}", handler, callback_group=group)

    # What is asked for, by services and by keys

    def set_paused(self, paused: bool) -> None:  # noqa: FBT001 - its only meaning
        """Pause or resume."""
        clock, words = self._playback.clock, "paused" if paused else f"playing at rate {self._playback.clock.rate:g}"
        if clock.paused == paused:
            self._tell(f"{words} already")
            return
        clock.set_paused(paused, time.monotonic())
        self._finish_step()
        self._tell(words)
        self._wake()

    def set_rate(self, rate: float) -> bool:
        """Play at a rate; where hz was set, the recorded timing counts again."""
        values = [Parameter("rate", value=float(rate))]
        if self._playback.hz > 0:
            values.append(Parameter("hz", value=0.0))
        result = self._node.set_parameters_atomically(values)
        if not result.successful:
            self._tell(f"rate unchanged: {result.reason}")
        return bool(result.successful)

    def seek(self, moment: int) -> bool:
        """Go on with what was recorded at a moment, nanoseconds since the epoch, or later."""
        try:
            places = self._playback.seek(moment, time.monotonic())
        except MabirdsError as error:
            self._tell(f"no seek: {error}")
            return False
        self._finish_step()
        self._tell(f"seek to {seconds(moment)}: {places}")
        self._wake()
        return True

    def seek_by(self, difference: int) -> bool:
        """Go on or back by so many nanoseconds, as far as the recording reaches."""
        first, last = self._playback.span
        return self.seek(min(max(self._playback.position(time.monotonic()) + difference, first), last))

    def step(self) -> None:
        """Publish the next demonstration, while paused."""
        reason = self.begin_step(1)
        self._tell(f"no step: {reason}" if reason else "next")

    def stop(self) -> None:
        """End playing."""
        self._playback.stopped = True
        self._finish_step()
        self._tell("stopped")
        self._wake()

    def begin_step(self, count: int) -> str:
        """While paused, publish the next demonstrations as learners take them; the reason if that cannot be."""
        if not self._playback.clock.paused:
            return "it is playing; pause it first"
        if self._step is not None:
            return "another step is under way"
        if not self._can_step():
            return "everything was played" if self._playback.finished else self._whom_it_waits_for()
        self._step, self._playback.owed = Future(), count
        self._step_owed, self._step_deadline = count, time.monotonic() + STEP_PATIENCE
        self._wake()
        return ""

    def look(self) -> None:
        """Has a step come to its end? Called after each look at what is due."""
        if self._step is None:
            return
        now, owed = time.monotonic(), self._playback.owed
        if owed < self._step_owed:
            self._step_owed, self._step_deadline = owed, now + STEP_PATIENCE
        if owed == 0 or now > self._step_deadline or not self._can_step():
            self._finish_step()

    def _can_step(self) -> bool:
        """Is there something to send that somebody takes, now or once it has learned?"""
        streams = self._playback.streams.values()
        return not self._playback.stopped and any(stream.open or stream.held_back for stream in streams)

    def _whom_it_waits_for(self) -> str:
        silent = [learner for learner, stream in self._playback.streams.items() if not stream.ready]
        return f"nothing heard of {', '.join(silent)}; start it, or play to listeners" if silent else "nothing to send"

    def _finish_step(self) -> None:
        step, self._step, self._playback.owed = self._step, None, 0
        if step is not None:
            step.set_result(None)

    async def _stepped(self, count: int) -> int:
        """How many demonstrations a step of ``count`` published; says so where they are less."""
        if reason := self.begin_step(count):
            self._tell(f"no step: {reason}")
            return 0
        if (step := self._step) is not None:
            await step
        published = count - self._step_owed
        short = f" of {count}: {self._why_short()}" if published < count else ""
        self._tell(f"published {published}{short}")
        return published

    def _why_short(self) -> str:
        if all(stream.sent >= stream.total for stream in self._playback.streams.values()):
            return "everything was played"
        if not self._playback.clock.paused:
            return "it was resumed"
        held = [name for name, stream in self._playback.streams.items() if stream.held_back]
        return f"held back by {', '.join(held)}" if held else self._whom_it_waits_for()

    # The services

    def _on_pause(self, _: Any, response: Any) -> Any:
        self.set_paused(paused=True)
        return response

    def _on_resume(self, _: Any, response: Any) -> Any:
        self.set_paused(paused=False)
        return response

    def _on_toggle_paused(self, _: Any, response: Any) -> Any:
        self.set_paused(not self._playback.clock.paused)
        return response

    def _on_is_paused(self, _: Any, response: Any) -> Any:
        response.paused = self._playback.clock.paused
        return response

    def _on_get_rate(self, _: Any, response: Any) -> Any:
        response.rate = self._playback.clock.rate
        return response

    def _on_set_rate(self, request: Any, response: Any) -> Any:
        response.success = self.set_rate(request.rate)
        return response

    async def _on_play_next(self, _: Any, response: Any) -> Any:
        response.success = await self._stepped(1) == 1
        return response

    async def _on_burst(self, request: Any, response: Any) -> Any:
        response.actually_burst = await self._stepped(request.num_messages or self._left())
        return response

    def _left(self) -> int:
        return sum(stream.total - stream.sent for stream in self._playback.streams.values())

    def _on_seek(self, request: Any, response: Any) -> Any:
        response.success = self.seek(nanoseconds(request.time))
        return response

    def _on_stop(self, _: Any, response: Any) -> Any:
        self.stop()
        return response

    def _on_play(self, request: Any, response: Any) -> Any:
        response.success = self._play_part(request)
        return response

    def _play_part(self, request: Any) -> bool:
        playback = self._playback
        if not playback.finished:
            self._tell("no play: it is playing; stop it first")
            return False
        start = playback.beginning + nanoseconds(request.start_offset)
        limits = (start, request.playback_duration), (0, request.playback_until_timestamp)
        ends = [origin + nanoseconds(limit) for origin, limit in limits if nanoseconds(limit) > 0]
        try:
            playback.play(Part(start, min(ends, default=Part().end)))
        except MabirdsError as error:
            self._tell(f"no play: {error}")
            return False
        self._tell(f"playing from {seconds(start)}")
        self._wake()
        return True
