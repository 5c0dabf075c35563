"""Messages that stock tools draw say what was learned."""

from pathlib import Path

import numpy as np
import pytest
from mabirds_msgs.msg import Constraints, LearnerStatus
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from mabirds_bringup.draw import drawings, messages
from mabirds_bringup.draw.colours import EDGES, css
from mabirds_bringup.draw.pictures import picture
from mabirds_bringup.draw.scalars import scalars_of
from mabirds_bringup.watch.edges import edge_states
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.games.scene import Scene, scene_of

PATROL = Path(__file__).resolve().parents[3] / "ros_ws" / "config" / "patrol.yaml"
HEADER = Header(frame_id="map")


@pytest.fixture(scope="module")
def scene() -> Scene:
    found = scene_of(build_game(load_experiment(PATROL)))
    assert found is not None
    return found


def cells(grid: OccupancyGrid) -> np.ndarray:
    return np.array(grid.data, dtype=np.int8).reshape(grid.info.height, grid.info.width)


def found(*names: str) -> Constraints:
    return Constraints(names=list(names), confidences=[1.0, 0.96, 0.99][: len(names)], level=0.95)


def test_costs_are_shares_of_the_largest(scene: Scene) -> None:
    omega = np.zeros(100)
    omega[0], omega[8], omega[49 + 48] = -4.0, 3.0, -1.0  # the top left corner, (1, 1), and the bottom right corner
    drawn = drawings.grids(HEADER, scene, omega, 2.0)
    first, second = map(cells, drawn.costs)
    assert (first[6, 0], second[0, 6]) == (100, 25)
    assert first.sum() + second.sum() == 125
    assert cells(drawn.keepout[0]).sum() == 100 == cells(drawn.keepout[0])[6, 0]
    assert cells(drawn.keepout[1]).sum() == 0
    assert (drawn.costs[0].header.frame_id, drawn.costs[0].info.resolution) == ("map", 1.0)


def test_a_mask_is_what_the_constraints_say_once_there_are_some(scene: Scene) -> None:
    drawn = drawings.grids(HEADER, scene, np.full(100, -9.0), 2.0, found("expert_1 in (0, 2)", "sharing a cell"))
    assert cells(drawn.keepout[0]).sum() == 100 == cells(drawn.keepout[0])[6, 2]
    assert cells(drawn.keepout[1]).sum() == 0
    assert set(drawn.keepout[0].data) == {0, 100}  # what a keepout filter of Nav2 takes


def test_nothing_learned_is_an_empty_map(scene: Scene) -> None:
    drawn = drawings.grids(HEADER, scene, np.zeros(100), 0.1)
    assert all(cells(grid).sum() == 0 for grid in (*drawn.costs, *drawn.keepout))


def test_surer_constraints_are_denser(scene: Scene) -> None:
    constraints = found("expert_1 in (0, 2)", "expert_1 in (0, 3)", "sharing a cell")
    clear, sure, unsure, words = drawings.constraint_markers(HEADER, scene, constraints).markers
    assert clear.action == Marker.DELETEALL
    assert sure.color.a == pytest.approx(1.0)
    assert drawings.FAINTEST < unsure.color.a < 0.6
    assert (round(sure.pose.position.x), round(sure.pose.position.y)) == (2, 6)
    assert words.text == "sharing a cell: 0.990"
    assert [marker.id for marker in (sure, unsure, words)] == [0, 1, 2]


def status(**fields: object) -> LearnerStatus:
    return LearnerStatus(metric_names=["omega_norm"], metric_values=[2.0], **fields)


SCHEDULE = EdgeSchedule(("ann", "bob", "cid"), (frozenset({(0, 1), (1, 0), (2, 1)}), frozenset({(1, 2)})))


@pytest.mark.parametrize(
    ("bob", "expected"),
    [
        (None, ["unknown", "unknown"]),
        (status(iteration=1), ["unknown", "unknown"]),
        (status(iteration=2, mixed_from=["ann", "cid"]), ["delivered", "delivered"]),
        (status(iteration=2, mixed_from=["ann"]), ["delivered", "missed"]),
        (status(iteration=3, mixed_from=[]), ["closed", "closed"]),
        (status(iteration=3, mixed_from=[], waiting_for=["cid"]), ["delivered", "late"]),
        (status(iteration=3, mixed_from=[], waiting_for=["demonstration"]), ["closed", "closed"]),
    ],
)
def test_edges_are_in_the_state_that_their_receiver_tells(bob: LearnerStatus | None, expected: list[str]) -> None:
    states = edge_states(SCHEDULE, {"ann": None, "bob": bob, "cid": None})
    assert set(states) == {(0, 1), (1, 0), (1, 2), (2, 1)}
    assert [states[0, 1], states[2, 1]] == expected


def test_arrows_have_the_colours_of_their_states(scene: Scene) -> None:
    states = edge_states(SCHEDULE, {"bob": status(iteration=2, mixed_from=["ann"])})
    markers = drawings.network_markers(HEADER, SCHEDULE.learners, states, scene.raster).markers
    arrows = [marker for marker in markers if marker.type == Marker.ARROW and marker.action == Marker.ADD]
    assert sorted(css(arrow.color) for arrow in arrows) == sorted(EDGES[state] for state in states.values())
    assert len({(arrow.points[0].x, arrow.points[0].y) for arrow in arrows}) == 4
    assert {marker.text for marker in markers} >= {"ann", "bob", "cid"}


def test_every_number_of_a_status_has_a_name() -> None:
    message = LearnerStatus(
        iteration=7,
        backlog=2,
        metric_names=["omega_norm", "weight_sent.bob", "a gap"],
        metric_values=[2.0, 3.0, float("nan")],
        drop_counts=[1, 4],
    )
    shown = scalars_of(message)
    assert {name: shown[name] for name in ("iteration", "backlog", "omega_norm", "weight_sent_bob", "dropped")} == {
        "iteration": 7,
        "backlog": 2,
        "omega_norm": 2.0,
        "weight_sent_bob": 3.0,
        "dropped": 5,
    }
    assert "a_gap" not in shown


def test_a_picture_shows_grids_at_their_places(scene: Scene) -> None:
    omega = np.zeros(100)
    omega[0] = -1.0
    drawn = {
        "/learner_1/drawn/costs/expert_1": drawings.grids(HEADER, scene, omega, 0.5).costs[0],
        "/learner_1/drawn/imagined/expert_1": messages.path(HEADER, np.array([[0.5, 0.5], [6.5, 0.5]])),
        "/drawn/scene": drawings.scene_markers(HEADER, scene),
    }
    figure = picture(drawn)
    titles = [axis.get_title() for axis in figure.axes if axis.get_title()]
    assert titles == ["/learner_1/drawn/costs/expert_1", "/drawn/scene"]
    figure.canvas.draw()
    pixels, axis = np.asarray(figure.canvas.buffer_rgba())[..., :3], figure.axes[0]  # type: ignore[attr-defined]

    def colour_at(x: float, y: float) -> list[int]:
        column, row = axis.transData.transform((x, y))
        return [int(part) for part in pixels[len(pixels) - int(row) - 1, int(column)]]

    assert max(colour_at(0.5, 6.5)) < 10  # the costly corner is black
    assert min(colour_at(6.5, 6.5)) > 245
    red, green, blue = colour_at(3.5, 0.5)
    assert red > 180  # the path
    assert max(green, blue) < 90
