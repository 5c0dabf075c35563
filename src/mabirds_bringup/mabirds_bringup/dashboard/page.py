"""The live page: who learns, who hears whom, curves, maps, and the player's controls for those who have the key."""

import html
import secrets
from collections.abc import Callable
from typing import Any

from nicegui import ui

from mabirds_bringup.dashboard.board import PERIOD, Board, LearnerView, Snapshot
from mabirds_bringup.dashboard.drawings import cost_map, graph
from mabirds_bringup.draw.colours import EDGES
from mabirds_bringup.watch.eta import eta_text, remaining
from mabirds_bringup.watch.overview import consensus_words
from mabirds_bringup.watch.player_words import player_words
from mabirds_core.texts import sanitize

CURVES = (
    ("nats", "newest demonstration, before it was learned [nats]", "value"),
    ("consensus", "largest distance from the mean of all learners", "log"),
    ("backlog", "demonstrations that wait to be learned", "value"),
)

STYLE = """
.maps, .top { display: flex; flex-wrap: wrap; gap: 1rem; }
.card { border: 1px solid #ddd; border-radius: 6px; padding: .7rem; background: white; box-sizing: border-box; }
.card, .maps, .top, .nicegui-content { max-width: calc(100vw - 1.5rem); min-width: 0; }
.nicegui-content { padding: .75rem; }
.map { width: min(270px, 84vw); } .map svg, .graph svg { width: 100%; height: auto; border: 1px solid #bbb; }
.graph svg { border: 0; } .graph { width: min(320px, 84vw); } .curve { width: min(370px, 84vw); height: 250px; }
.table { overflow-x: auto; max-width: 100%; display: block; }
td, th { padding: .15rem .6rem; text-align: right; white-space: nowrap; }
td:first-child, th:first-child { text-align: left; } body { background: #f5f5f5; }
"""


def make_page(board: Board, secret: str) -> None:
    """Register the page.

    Parameters
    ----------
    board : Board
        What is shown.
    secret : str
        Who gives it, as ``?key=``, may control the player; all others may look.
    """

    @ui.page("/", title=f"MA-BIRDS: {board.experiment.name}")
    def index(key: str = "") -> None:
        _Page(board, may_control=secrets.compare_digest(key.encode(), secret.encode()))

    del index  # nicegui keeps it


class _Page:
    """One open page."""

    def __init__(self, board: Board, *, may_control: bool) -> None:
        self._board, self._updates = board, list[Callable[[Snapshot], object]]()
        ui.add_css(STYLE)
        ui.label(f"MA-BIRDS: {board.experiment.name}").classes("text-2xl")
        self._player(may_control=may_control)
        with ui.element("div").classes("top"):
            self._graph()
            self._learners()
        with ui.element("div").classes("top"):
            for name, words, kind in CURVES:
                self._curve(name, words, kind)
        self._maps()
        ui.timer(PERIOD, self._update)

    def _update(self) -> None:
        snapshot = self._board.snapshot
        for update in self._updates:
            update(snapshot)

    def _player(self, *, may_control: bool) -> None:
        with ui.element("div").classes("card"):
            state = ui.label().props("data-testid=player")
            self._updates.append(lambda snapshot: state.set_text(_player_text(snapshot)))
            if not may_control:
                ui.label("read only: open the address with the key to control the player").classes("text-xs")
                return
            with ui.row().classes("items-center"):
                pause = ui.button("pause", on_click=lambda: self._board.ask("toggle_paused")).props("data-testid=pause")
                ui.button("next", on_click=lambda: self._board.ask("play_next")).props("data-testid=next")
                rate = ui.number("rate", value=1.0, min=0.01, max=1e4).props("data-testid=rate dense")
                ui.button("set", on_click=lambda: self._set_rate(rate.value)).props("data-testid=set-rate")
            self._updates.append(lambda snapshot: pause.set_text(_pause_text(snapshot)))

    def _set_rate(self, rate: Any) -> None:
        if rate is None or not rate > 0:
            ui.notify(f"rate {rate}: expected a number above 0")
        else:
            self._board.ask("set_rate", rate=float(rate))

    def _graph(self) -> None:
        learners = self._board.experiment.edge_schedule.learners
        with ui.element("div").classes("card graph"):
            legend = " ".join(f'<span style="color:{EDGES[state]}">■ {state}</span>' for state in EDGES)
            ui.html(f"<b>Who hears whom</b><br><small>{legend}</small>", sanitize=False)
            drawing = ui.html(sanitize=False).props("data-testid=graph")
        self._updates.append(lambda snapshot: _set(drawing, graph(learners, snapshot.edges)))

    def _learners(self) -> None:
        with ui.element("div").classes("card"):
            ui.html("<b>Learners</b>", sanitize=False)
            table = ui.html(sanitize=False).classes("table")
            apart = ui.label().props("data-testid=consensus").classes("text-sm")
        total = self._board.experiment.iterations
        self._updates += [
            lambda snapshot: _set(table, learner_table(snapshot, total)),
            lambda snapshot: apart.set_text(_consensus_text(snapshot)),
        ]

    def _curve(self, name: str, words: str, kind: str) -> None:
        with ui.element("div").classes("card"):
            options = {
                "title": {"text": words, "textStyle": {"fontSize": 11}},
                "tooltip": {"trigger": "axis"},
                "legend": {"top": 27},
                "grid": {"left": 60, "right": 15, "top": 62, "bottom": 35},
                "xAxis": {"name": "iteration", "nameLocation": "middle", "nameGap": 22, "min": "dataMin"},
                "yAxis": {"type": kind, "scale": True},
                "series": [],
                "animation": False,
            }
            chart = ui.echart(options).classes("curve").props(f"data-testid=curve-{name}")

        def update(snapshot: Snapshot) -> None:
            series = [_series(label, points, kind) for label, points in sorted(snapshot.curves.get(name, {}).items())]
            if series != chart.options["series"]:
                chart.options["series"] = series
                chart.update()

        self._updates.append(update)

    def _maps(self) -> None:
        scene = self._board.scene
        if scene is None:
            return
        ui.html(
            "<b>What each learner takes places to cost each expert</b><br><small>darker: costlier; red: what experts"
            " may really not enter; lines: ways that the learner imagines; circle: goal</small>",
            sanitize=False,
        )
        holder, drawn = ui.element("div").classes("maps"), dict[tuple[str, int], ui.html]()

        def update(snapshot: Snapshot) -> None:
            for view in (view for view in snapshot.learners if view.costs is not None):
                assert view.costs is not None  # noqa: S101 - for the type checker
                for expert, costs in enumerate(view.costs):
                    drawing = drawn.get((view.name, expert)) or _new_map(holder, drawn, view, expert)
                    _set(drawing, cost_map(scene, costs, float(view.costs.max()), expert, view.paths))

        self._updates.append(update)


def _new_map(holder: Any, drawn: dict[tuple[str, int], ui.html], view: LearnerView, expert: int) -> ui.html:
    with holder, ui.element("div").classes("card map"):
        ui.label(f"{sanitize(view.name)}, expert {expert + 1}")
        drawn[view.name, expert] = ui.html(sanitize=False).props(f"data-testid=map-{view.name}-{expert + 1}")
    return drawn[view.name, expert]


def _set(element: ui.html, content: str) -> None:
    """Send only what has changed."""
    if element.content != content:
        element.set_content(content)


def _series(label: str, points: list[tuple[int, float]], kind: str) -> dict[str, Any]:
    data = [list(point) for point in points if kind != "log" or point[1] > 0]
    return {"name": label, "type": "line", "data": data, "symbolSize": 4}


def _player_text(snapshot: Snapshot) -> str:
    if snapshot.player is None:
        return "no player is heard"
    return f"player {sanitize(snapshot.player_name)}: {player_words(snapshot.player)}"


def _pause_text(snapshot: Snapshot) -> str:
    return "resume" if snapshot.player is not None and snapshot.player.paused else "pause"


def _consensus_text(snapshot: Snapshot) -> str:
    return consensus_words(snapshot.consensus, [view.content for view in snapshot.learners])


def learner_table(snapshot: Snapshot, total: int) -> str:
    """A row for each learner, as HTML; whatever others have put into their messages is text."""
    rows = "".join(_row(view, total) for view in snapshot.learners)
    head = "".join(f"<th>{name}</th>" for name in ("learner", "state", "learned", "it/s", "ETA", "queue", "drops"))
    return f"<table><tr>{head}</tr>{rows}</table>"


def _row(view: LearnerView, total: int) -> str:
    content = view.content
    if "state" not in content:
        return f"<tr><td>{html.escape(sanitize(view.name))}</td><td>silent</td></tr>"
    rate = content["iterations_per_second"]
    cells = {
        "state": content["state"],
        "learned": f"{content['last_demonstration']}/{total}",
        "rate": "" if rate is None else f"{rate:.3g}",
        "eta": eta_text(remaining(content["last_demonstration"], total, rate)),
        "backlog": str(content["backlog"]),
        "drops": str(sum(content["dropped"].values())),
    }
    name = html.escape(sanitize(view.name), quote=True)
    shown = "".join(f'<td data-testid="{name}-{key}">{html.escape(value)}</td>' for key, value in cells.items())
    return f"<tr><td>{name}</td>{shown}</tr>"
