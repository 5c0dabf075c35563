"""``mabirds import``: what robots and people did becomes demonstrations; what is doubtful is told by its name."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
import yaml
from robot_recordings import (
    ONE,
    OTHER,
    RULES,
    crossings,
    odometry,
    pose_stamped,
    robots_bag,
    sampled,
    transform,
    write_bag,
)
from rosbags.rosbag2 import StoragePlugin
from typer.main import get_command

from mabirds_bringup.application import app
from mabirds_bringup.importing.importer import Import, import_tracks
from mabirds_bringup.importing.reading import read_recording
from mabirds_bringup.importing.rules import ImportRules, load_rules
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError

HALL = np.array([10.0, 3.0])


def rules(**changes: Any) -> ImportRules:
    return ImportRules.model_validate({**RULES, **changes})


def imported(path: Path, given: ImportRules) -> Import:
    return import_tracks(read_recording(path, given), given, "rules.yaml")


def write_csv(path: Path, entries: list[tuple[float, str, float, float]]) -> Path:
    pl.DataFrame(entries, schema=["frame", "agent", "x", "y"], orient="row").write_csv(path)
    return path


def walk(name: str, start: tuple[float, float], end: tuple[float, float], times: Any) -> list[Any]:
    shares = (times - times[0]) / (times[-1] - times[0])
    return [(t, name, *(np.array(start) + s * (np.array(end) - start))) for t, s in zip(times, shares, strict=True)]


def pair(times: Any) -> list[Any]:
    """Both robots once, from where they wait to their goals."""
    return walk(ONE, (1, 1), (9, 1), times) + walk(OTHER, (9, 2), (1, 2), times)


TIMES = np.arange(0, 12.01, 0.2)
BY_LENGTH = {"episodes": {"by": "length", "length": 12.0}, "learners": {"count": 1}}


def test_the_command_makes_a_bag_and_an_experiment_that_can_be_learned(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    recording = robots_bag(tmp_path / "recording", count=10)
    (tmp_path / "rules.yaml").write_text(yaml.safe_dump({**RULES, "held_out": 0.3}))
    words = ["import", str(recording), "--rules", str(tmp_path / "rules.yaml"), "--out", str(tmp_path / "mine")]
    get_command(app)([*words, "--dry-run", "--json"], standalone_mode=False)
    told = json.loads(capfd.readouterr().out)
    assert not (tmp_path / "mine").exists()
    get_command(app)([*words, "--json"], standalone_mode=False)
    assert json.loads(capfd.readouterr().out) == {**told, "out": str(tmp_path / "mine")}
    assert told["demonstrations"] == {"learner_1": 3, "learner_2": 3}
    assert told["held_out"] == 3
    experiment = load_experiment(tmp_path / "mine" / "experiment.yaml")
    game = build_game(experiment)
    for bag, count in (("bag", 3), ("held_out", 2)):
        with DemonstrationBag(tmp_path / "mine" / bag, game, experiment.learners) as reader:
            assert len(list(reader.trajectories("learner_1"))) == count
    assert (tmp_path / "mine" / "import.png").stat().st_size > 10_000
    assert "residual" in (tmp_path / "mine" / "import.md").read_text().lower()


def test_the_recording_to_try_has_what_its_document_says(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    tool = Path(__file__).resolve().parents[3] / "tools" / "two_robots.py"
    subprocess.run([sys.executable, str(tool), str(tmp_path)], check=True, timeout=120)
    words = ["import", tmp_path / "recording", "--rules", tmp_path / "rules.yaml", "--out", tmp_path / "mine"]
    get_command(app)([*map(str, words), "--dry-run", "--json"], standalone_mode=False)
    told = json.loads(capfd.readouterr().out)
    assert (told["demonstrations"], told["held_out"]) == ({"learner_1": 8, "learner_2": 8}, 7)
    gaps = [count for what, count in told["findings"].items() if "/robot_2/odom: gap of more than 1 s" in what]
    assert gaps == [1]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_all_kinds_of_messages_tell_the_same(tmp_path: Path, storage: StoragePlugin) -> None:
    times, knots = crossings(2, np.random.default_rng(0))
    kinds = {"odometry": odometry, "pose": pose_stamped}
    found = []
    for name, make in kinds.items():
        messages = {
            topic: [(t, make(t, p)) for t, p in zip(*sampled(times, knots, agent, 10.0), strict=True)]
            for agent, topic in enumerate((ONE, OTHER))
        }
        found.append(imported(write_bag(tmp_path / name, messages, storage), rules()))
    transforms = [
        (t, transform(t, p, child))
        for agent, child in enumerate((ONE, OTHER))
        for t, p in zip(*sampled(times, knots, agent, 10.0), strict=True)
    ]
    found.append(
        imported(write_bag(tmp_path / "tf", {"/tf": sorted(transforms, key=lambda e: e[0])}, storage), rules())
    )
    states = [np.concatenate([of.trajectory.states for of in result.demonstrations]) for result in found]
    assert len(states[0]) == 2
    assert all(np.array_equal(states[0], others) for others in states[1:])


def test_demonstrations_exported_at_another_rate_come_back(tmp_path: Path) -> None:
    """Twice as many samples as steps, plus rests in between: the same trajectories to rounding."""
    first = imported(robots_bag(tmp_path / "recording", count=8), rules())
    game, messages = build_game(first.experiment), dict[str, list[Any]]()
    for agent, topic in enumerate((ONE, OTHER)):
        entries = list[Any]()
        for number, of in enumerate(first.demonstrations):
            places = game.positions(of.trajectory.states)[0, :, agent]  # type: ignore[attr-defined]
            stamps = 100.0 * number + np.arange(0, game.horizon + 1e-9, 0.5)
            dense = np.column_stack(
                [np.interp(stamps - 100.0 * number, np.arange(game.horizon + 1), places[:, axis]) for axis in (0, 1)]
            )
            entries += [(t, odometry(t, p)) for t, p in zip(stamps, dense, strict=True)]
        messages[topic] = entries
    again = imported(
        write_bag(tmp_path / "exported", messages),
        rules(
            episodes={"by": "length", "length": float(game.horizon)},
            steps={"time_step": 1.0, "max_speed": first.experiment.game.max_speed, "horizon": game.horizon},
        ),
    )
    assert len(again.demonstrations) == len(first.demonstrations) == 8
    for before, after in zip(
        sorted(first.demonstrations, key=lambda of: of.episode.begin), again.demonstrations, strict=True
    ):
        shown = [
            other
            for other in again.demonstrations
            if np.allclose(other.trajectory.states, before.trajectory.states, atol=1e-6)
        ]
        assert len(shown) == 1, after.episode


@pytest.mark.parametrize(("by", "counts"), [("file", [2, 2]), ("host", [2, 2]), ("round_robin", [2, 2])])
def test_demonstrations_are_dealt_to_learners(tmp_path: Path, by: str, counts: list[int]) -> None:
    given = rules(learners={"count": 2, "by": by})
    paths = [tmp_path / f"host_{number}" / "recording" for number in range(2)]
    for number, path in enumerate(paths):
        path.parent.mkdir()
        robots_bag(path, count=2, seed=number)
    tracks = [track for path in paths for track in read_recording(path, given)]
    result = import_tracks(tracks, given, "rules.yaml")
    assert [len(stream) for stream in result.learned.values()] == counts
    sources = [{of.episode.source for of in stream} for stream in result.learned.values()]
    assert sources == ([{str(path)} for path in paths] if by != "round_robin" else [set(map(str, paths))] * 2)


def test_people_are_told_by_their_direction(tmp_path: Path) -> None:
    entries = pair(TIMES) + [(t + 30, f"b{name}", x, y) for t, name, x, y in pair(TIMES)]
    path = write_csv(tmp_path / "people.csv", entries)
    experts = [
        {"heads": heads, "goal": of["goal"]} for heads, of in zip(("east", "west"), RULES["experts"], strict=True)
    ]
    result = imported(path, rules(experts=experts, episodes={"by": "together"}, learners={"count": 1}))
    assert [[track.agent for track in of.episode.tracks] for of in result.demonstrations] == [
        [ONE, OTHER],
        [f"b{ONE}", f"b{OTHER}"],
    ]


def test_pauses_cut_recordings(tmp_path: Path) -> None:
    path = robots_bag(tmp_path / "recording", count=3, noise=0.0)
    back = [{**of, "goal": {"centre": [5.0, 2.6], "radius": 0.4}} for of in RULES["experts"]]
    result = imported(path, rules(experts=back, episodes={"by": "pauses", "pause": 0.4}, learners={"count": 1}))
    assert len(result.demonstrations) == 6  # to where they wait, three ways there and two back


def with_fault(tmp_path: Path, entries: list[Any]) -> tuple[Import, str]:
    result = imported(write_csv(tmp_path / "some.csv", entries), rules(**BY_LENGTH))
    return result, "; ".join(f"{what} {count}" for what, count in result.findings.items())


def test_numbers_that_are_none_are_left_out_and_counted(tmp_path: Path) -> None:
    entries = pair(TIMES)
    entries[5:7] = [(*entry[:2], float("nan"), entry[3]) for entry in entries[5:7]]
    result, words = with_fault(tmp_path, entries)
    assert f"{ONE}: sample with a number that is none (NaN) 2" in words
    assert len(result.demonstrations) == 1


def test_a_single_far_sample_is_left_out_and_counted(tmp_path: Path) -> None:
    entries = pair(TIMES)
    entries[9] = (entries[9][0], ONE, 9.0, 2.9)
    result, words = with_fault(tmp_path, entries)
    assert f"{ONE}: single sample far from its neighbours 1" in words
    assert len(result.demonstrations) == 1


def test_times_that_go_back_are_left_out_and_counted(tmp_path: Path) -> None:
    entries = pair(TIMES)
    entries[9] = (entries[7][0], *entries[9][1:])
    result, words = with_fault(tmp_path, entries)
    assert f"{ONE}: sample whose time repeats or goes back 1" in words
    assert len(result.demonstrations) == 1


def test_frames_that_are_missing_cut_the_track(tmp_path: Path) -> None:
    entries = [entry for entry in pair(TIMES) if not 5 < entry[0] < 8]
    with pytest.raises(BagError, match=r"gap of more than 1 s, at which the track is cut: 1"):
        with_fault(tmp_path, entries)


def test_short_gaps_are_bridged(tmp_path: Path) -> None:
    result, words = with_fault(tmp_path, [entry for entry in pair(TIMES) if not 5 < entry[0] < 5.7])
    assert (len(result.demonstrations), words) == (1, "")


def test_agents_that_are_swapped_are_named(tmp_path: Path) -> None:
    def renamed(entry: Any) -> Any:
        name = {ONE: OTHER, OTHER: ONE}[entry[1]] if entry[0] > 4 else entry[1]
        return (entry[0], name, *entry[2:])

    with pytest.raises(BagError, match=rf"{ONE} and {OTHER} seem to be swapped, first at (3\.8|4\.0)"):
        with_fault(tmp_path, sorted(map(renamed, pair(TIMES)), key=lambda entry: entry[0]))


def test_a_missing_agent_is_named(tmp_path: Path) -> None:
    with pytest.raises(BagError, match=rf"no places of {OTHER}; there is {ONE}"):
        with_fault(tmp_path, walk(ONE, (1, 1), (9, 1), TIMES))


def test_agents_that_are_never_seen_together_are_told_with_their_times(tmp_path: Path) -> None:
    entries = walk(ONE, (1, 1), (9, 1), TIMES) + walk(OTHER, (9, 2), (1, 2), TIMES + 100)
    with pytest.raises(BagError, match=r"never seen at one time: .*12\.000 s, .* from 100\.000 .*clocks"):
        with_fault(tmp_path, entries)


def test_clocks_that_are_apart_are_refused_with_both(tmp_path: Path) -> None:
    times, knots = crossings(1, np.random.default_rng(0))
    messages = {
        topic: [(t, odometry(t + 7 * agent, p)) for t, p in zip(*sampled(times, knots, agent, 10.0), strict=True)]
        for agent, topic in enumerate((ONE, OTHER))
    }
    path = write_bag(tmp_path / "bag", messages)
    with pytest.raises(BagError, match=rf"clocks are 7\.000 s apart.*{ONE} \+0\.000 s, {OTHER} \+7\.000 s"):
        imported(path, rules(learners={"count": 1}))
    assert len(imported(path, rules(clock="received", learners={"count": 1})).demonstrations) == 1


def test_places_in_different_frames_are_refused(tmp_path: Path) -> None:
    messages = {
        topic: [(t, odometry(t, np.ones(2), frame)) for t in TIMES] for topic, frame in ((ONE, "map"), (OTHER, "odom"))
    }
    with pytest.raises(BagError, match=rf"different frames: {ONE} in 'map', {OTHER} in 'odom'"):
        imported(write_bag(tmp_path / "bag", messages), rules())


def test_what_ends_before_the_goal_is_dropped(tmp_path: Path) -> None:
    entries = [entry for entry in pair(TIMES) if entry[0] < 8]
    given = rules(**{**BY_LENGTH, "episodes": {"by": "length", "length": 7.0}}, steps={"time_step": 1.0, "horizon": 12})
    with pytest.raises(BagError, match="episode ends before an agent is at its goal, dropped: 1"):
        imported(write_csv(tmp_path / "some.csv", entries), given)


def test_what_is_too_fast_for_the_game_is_dropped(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "some.csv", pair(TIMES))
    with pytest.raises(BagError, match=r"episode further than 0\.25 m from any trajectory of the game"):
        imported(path, rules(**BY_LENGTH, steps={"time_step": 1.0, "max_speed": 0.5}))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("frame,agent,x\n1,a,2\n", "there is no column y"),
        ("frame,agent,x,y\n1,a,2,left\n", "expected numbers"),
    ],
)
def test_csv_files_that_cannot_be_read_say_why(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "some.csv").write_text(text)
    with pytest.raises(BagError, match=words):
        read_recording(tmp_path / "some.csv", rules())


def test_bags_without_places_and_files_that_are_no_bags_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="there is no such recording"):
        read_recording(tmp_path / "none", rules())
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match="cannot be read as a bag"):
        read_recording(tmp_path / "empty", rules())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"area": {}}, "either `corners` or `map`"),
        ({"area": {"corners": [[1, 1], [0, 0]]}}, "lower left"),
        ({"episodes": {"by": "together"}}, "agents with `heads`"),
        ({"experts": [{"goal": {"centre": [1, 1], "radius": 1}}]}, "either `agent` or `heads`"),
        ({"experts": [{"agent": "a", "goal": {"centre": [1, 1], "radius": 1}}]}, "need `enter`"),
        ({"colour": "red"}, "colour"),
        ({"game": {}}, "expected at least its `kind`"),
    ],
)
def test_wrong_rules_are_named(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    (tmp_path / "rules.yaml").write_text(yaml.safe_dump({**RULES, **change}))
    with pytest.raises(ExperimentError, match=words):
        load_rules(tmp_path / "rules.yaml")


def test_a_map_gives_the_area(tmp_path: Path) -> None:
    from PIL import Image

    Image.new("L", (200, 60), 255).save(tmp_path / "hall.pgm")
    (tmp_path / "hall.yaml").write_text("{image: hall.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.0]}")
    (tmp_path / "rules.yaml").write_text(yaml.safe_dump({**RULES, "area": {"map": "hall.yaml"}}))
    given = load_rules(tmp_path / "rules.yaml")
    result = imported(robots_bag(tmp_path / "recording", count=2), given)
    np.testing.assert_allclose(result.experiment.game.arena, HALL)
    (tmp_path / "hall.yaml").write_text("{image: hall.pgm, resolution: 0.05, origin: [0.0, 0.0, 0.3]}")
    with pytest.raises(MabirdsError, match="yaw"):
        imported(tmp_path / "recording", given)


def test_a_door_is_counted_from_the_corner_of_the_area(tmp_path: Path) -> None:
    door = {"centre": [9.0, 0.7], "until": [9.0, 1.3], "radius": 0.4}
    experts = [{**RULES["experts"][0], "goal": door}, RULES["experts"][1]]
    area = {"corners": [[-1.0, -0.5], [10.0, 3.0]]}
    result = imported(write_csv(tmp_path / "some.csv", pair(TIMES)), rules(**BY_LENGTH, experts=experts, area=area))
    region = result.experiment.game.drones[0].goal_region
    assert (region.centre, region.until, region.radius) == ((10.0, 1.2), (10.0, 1.8), 0.4)
