"""Files of any content: bags, experiments and schedules are read or refused by name, in little time and memory."""

import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from copy import deepcopy
from datetime import date
from pathlib import Path
from typing import Any

import pytest
import yaml
from bags import LAYOUTS, lies, mcap_file, rewritten
from damage import Example, examples, outcome
from hypothesis import given, settings
from hypothesis import strategies as st

from mabirds_core.consensus.assumptions import validate
from mabirds_core.consensus.generators import gossip
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ExperimentError, ScheduleError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError

MAX_LENGTH = 6000
"""Characters of an error, however much is wrong."""

BYTES = pytest.mark.parametrize(
    ("seed", "count"), [(1, 60), *(pytest.param(seed, 1000, marks=pytest.mark.slow) for seed in range(2, 6))]
)
EXAMPLES = pytest.mark.parametrize("count", [150, pytest.param(3000, marks=pytest.mark.slow)])


@pytest.fixture
def other(make_experiment: Callable[..., Path]) -> Experiment:
    """The same experiment with other demonstrations."""
    demonstrations = {"bag": "bag", "per_learner": 6, "seed": 1}
    return load_experiment(make_experiment(name="other", change={"demonstrations": demonstrations}))


Content = dict[str, list[Any]]


def content_of(experiment: Experiment) -> Content:
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: [bag.message(name, n + 1) for n in range(bag.count(name))] for name in experiment.learners}


def fuzz(
    read: Callable[[], Any], file: Path, cases: Iterator[Example], refusal: type[Exception]
) -> Iterator[tuple[Example, Any]]:
    """What was read of each example that was not refused; both must happen, or the examples test nothing."""
    counts: Counter[bool] = Counter()
    for case in cases:
        found = outcome(read, file, case, refusal)
        refused = isinstance(found, refusal)
        counts[refused] += 1
        if refused:
            assert 0 < len(str(found)) < MAX_LENGTH, case.name
            assert str(file.parent) in str(found), case.name
        else:
            yield case, found
    assert counts[True], "no example was refused"


@BYTES
def test_a_damaged_bag_is_refused_or_unharmed(experiment: Experiment, other: Experiment, seed: int, count: int) -> None:
    """With checksums: whatever is read is what was recorded, here or where a piece was brought in from."""
    file, sound = mcap_file(experiment.demonstrations.bag), [content_of(experiment), content_of(other)]
    donor = mcap_file(other.demonstrations.bag).read_bytes()
    cases = examples(file.read_bytes(), donor, seed, count)
    for case, found in fuzz(lambda: content_of(experiment), file, cases, BagError):
        assert found in sound, case.name


@BYTES
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_damaged_bag_without_checksums_is_refused_or_holds_what_the_game_allows(
    experiment: Experiment, other: Experiment, layout: str, seed: int, count: int
) -> None:
    file = mcap_file(experiment.demonstrations.bag)
    content = rewritten(file.read_bytes(), layout)
    donor = rewritten(mcap_file(other.demonstrations.bag).read_bytes(), layout)
    for case, found in fuzz(lambda: content_of(experiment), file, examples(content, donor, seed, count), BagError):
        assert all(len(messages) > 0 for messages in found.values()), case.name


@BYTES
def test_damaged_metadata_are_refused_or_lead_to_the_same_bag(experiment: Experiment, seed: int, count: int) -> None:
    file, sound = experiment.demonstrations.bag / "metadata.yaml", content_of(experiment)
    content = file.read_bytes()
    for case, found in fuzz(lambda: content_of(experiment), file, examples(content, content, seed, count), BagError):
        assert found == sound, case.name


def loaded(file: Path) -> Experiment:
    """An experiment with what every process makes of it at its start."""
    experiment = load_experiment(file)
    assert build_game(experiment).digest
    assert experiment.edge_schedule.digest
    return experiment


@BYTES
def test_a_damaged_experiment_is_refused_or_another_one(
    make_experiment: Callable[..., Path], seed: int, count: int
) -> None:
    slots = [[["learner_1", "learner_2"]], [], [["learner_2", "learner_1"]]]
    file = make_experiment(schedule={"kind": "slots", "slots": slots, "undirected": True})
    content, donor = file.read_bytes(), (Path(__file__).parents[2] / "ros_ws/config/patrol.yaml").read_bytes()
    for case, found in fuzz(lambda: loaded(file), file, examples(content, donor, seed, count), ExperimentError):
        assert isinstance(found, Experiment), case.name


NUMBERS = st.one_of(
    st.integers(-3, 12),
    st.sampled_from([2**31, 2**63, 2**64, 10**30, -(10**30), 1e300, 1e-300, float("nan"), float("inf"), -0.0]),
    st.floats(),
)
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, st.text(max_size=20), st.just(date(2026, 1, 1)), st.just("x" * 3000)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=3)),
    max_leaves=8,
)


def places(content: Any, before: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Where values stand in nested settings."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield (*before, key)
        yield from places(value, (*before, key))


@st.composite
def changed(draw: st.DrawFn, content: dict[str, Any]) -> dict[str, Any]:
    """The settings with one to three values replaced, taken out, or put in where nothing was."""
    content = deepcopy(content)
    for _ in range(draw(st.integers(1, 3))):
        *way, last = draw(st.sampled_from(sorted(places(content), key=str)))
        parent = content
        for key in way:
            parent = parent[key]
        match draw(st.sampled_from(["replace", "replace", "replace", "take out", "put in"])):
            case "replace":
                parent[last] = draw(VALUES)
            case "take out":
                del parent[last]
            case "put in" if isinstance(parent, dict):
                parent[draw(st.text(max_size=8))] = draw(VALUES)
    return content


@EXAMPLES
@pytest.mark.parametrize("kind", ["static", "gossip", "slots"])
def test_settings_of_any_kind_are_refused_or_an_experiment(
    make_experiment: Callable[..., Path], kind: str, count: int
) -> None:
    schedule = {
        "static": {"kind": "static", "graph": "ring"},
        "gossip": {"kind": "gossip", "slots": 5, "seed": 1},
        "slots": {"kind": "slots", "slots": [[["learner_1", "learner_2"]], []], "undirected": True, "end": "repeat"},
    }[kind]
    file = make_experiment(schedule=schedule)
    original = yaml.safe_load(file.read_text(encoding="utf-8"))

    @settings(max_examples=count, deadline=None)
    @given(changed(original))
    def check(content: dict[str, Any]) -> None:
        text = yaml.safe_dump(content)
        found = outcome(lambda: loaded(file), file, Example(text, text.encode()), ExperimentError)
        assert len(str(found)) < MAX_LENGTH

    check()


@EXAMPLES
def test_slots_of_any_kind_are_refused_or_a_valid_schedule(count: int) -> None:
    edges = st.tuples(st.integers(-1, 5), st.integers(-1, 5))
    slots = st.lists(st.frozensets(edges, max_size=8), max_size=6).map(tuple)

    @settings(max_examples=count, deadline=None)
    @given(st.lists(st.text(max_size=5), max_size=5).map(tuple), slots, st.sampled_from(["repeat", "hold", "stop"]))
    def check(names: tuple[str, ...], slots: tuple[frozenset[tuple[int, int]], ...], end: Any) -> None:
        try:
            report = validate(EdgeSchedule(names, slots, end))
        except ScheduleError:
            return
        assert report.largest_sum_error <= 1e-12
        assert 1 <= report.connectivity_window <= len(slots)
        assert report.contraction <= 1 + 1e-9

    check()


SMALL = Path(__file__).parents[2] / "ros_ws/config/patrol.yaml"


def refused(directory: Path, text: str) -> str:
    """The refusal of an experiment file of this text, within seconds."""
    file = directory / "experiment.yaml"
    found = outcome(lambda: loaded(file), file, Example("", text.encode()), ExperimentError)
    assert isinstance(found, ExperimentError)
    assert len(str(found)) < MAX_LENGTH
    return str(found).removeprefix(f"{file}: ")


BOMB = "a: &a [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 10)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
MERGE_BOMB = "a: &a {x: 1}\n" + "".join(
    f"{new}: &{new} {{<<: [{', '.join([f'*{old}'] * 10)}]}}\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)
LONG_CHAIN = "a0: &a0 {x0: 1}\n" + "".join(f"a{n}: &a{n} {{<<: *a{n - 1}, x{n}: 1}}\n" for n in range(1, 1000))


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ("name: 2001-13-45", "is not YAML: month must be in 1..12"),
        ("2001-01-01: x", "keys must be str, int, float, bool or None, not date"),
        ("name: !!int ''", "is not YAML: string index out of range"),
        ("name: !!bool x", "is not YAML: 'x'"),
        ("name: !!timestamp x", "is not YAML: 'NoneType' object has no attribute 'groupdict'"),
        ("seed: " + "9" * 5000, "is not YAML: Exceeds the limit (4300 digits)"),
        ("seed: 0x" + "f" * 5000, "Exceeds the limit (4300 digits)"),
        (BOMB, "its settings, with aliases written out, have more than 4194304 characters"),
        (MERGE_BOMB, "<<: expected one mapping"),
        ("a: &a {x: 1}\nb: {<<: *a, <<: *a}", "<<: expected one mapping"),
        (LONG_CHAIN, "its merge keys stand for more than 100000 settings"),
        ("name: &again [*again]", "Circular reference detected"),
        ("name: x" + "x" * 2**20, "is not YAML: it has more than 1048576 bytes"),
        ("".join(f"key{n}: {n}\n" for n in range(30_000)), "... ("),
        ("? " + "x" * 100_000 + "\n: 1", "... (100000 characters): Extra inputs"),
        ('"\\e[2J": 1', "\\x1b[2J: Extra inputs are not permitted"),
    ],
    ids=lambda value: value[:30],
)
def test_what_no_experiment_can_be_is_refused_in_no_time(tmp_path: Path, text: str, refusal: str) -> None:
    assert refusal in refused(tmp_path, text)


CELLS = [[0, column] for column in range(200)]
ONE_EXPERT = {"starts": [[[0, 0]]], "goals": [[0, 1]], "horizon": 5}
NAMES = [f"learner_{number}" for number in range(1000)]


@pytest.mark.parametrize(
    ("change", "refusal"),
    [
        (
            {"game": {"map": "." * 200, "starts": [CELLS], "goals": CELLS[::-1], "horizon": 3}},
            "game: 200 experts on a 1x200 map make 1e+300 joint state-action pairs, expected at most 2e+07",
        ),
        (
            {"game": {"map": "." * 100_000, **ONE_EXPERT, "horizon": 10_000}},
            "game: 1 experts on a 1x100000 map make 100000 joint states, 1e+09 values in 10002 steps, expected at most",
        ),
        (
            {"game": {"map": "." * 500_000, **ONE_EXPERT, "starts": [*[[[0, 0]]] * 20_000, [[9, 9]]]}},
            "game: cell (9, 9) as (row, column): expected a free cell of the 1x500000 map",
        ),
        ({"demonstrations": {"bag": "a\0b", "per_learner": 6}}, "demonstrations.bag: embedded null byte"),
        ({"learners": [*NAMES, "one_more"]}, "learners: Tuple should have at most 1000 items"),
        ({"learners": ["l" * 61]}, "learners.0: String should have at most 60 characters"),
        ({"learners": NAMES, "schedule": {"kind": "gossip", "slots": 1}}, "1 slots of 1 random pairs never connected"),
        (
            {"learners": NAMES, "schedule": {"kind": "gossip", "slots": 100_000}},
            "100000 slots: expected at most 5 for 1000 learners; take fewer",
        ),
        ({"seed": float("nan")}, "seed: "),
        ({"constraint_threshold": float("inf")}, "constraint_threshold: Input should be a finite number"),
        ({"constraint_threshold": -1}, "constraint_threshold: Input should be greater than or equal to 0"),
        (
            {"algorithm": {"steps": {"alpha": 1.0, "beta": 1.0}, "rollouts": 1_000_000}},
            None,
        ),
        ({"iterations": 2**64}, "iterations: Input should be less than or equal to 1000000"),
    ],
    ids=lambda value: (value or "")[:40] if not isinstance(value, dict) else "",
)
def test_settings_that_no_machine_can_hold_are_refused_in_no_time(
    make_experiment: Callable[..., Path], tmp_path: Path, change: dict[str, Any], refusal: str
) -> None:
    content = yaml.safe_load(make_experiment().read_text(encoding="utf-8")) | change
    if refusal is None:  # fits with a short horizon, and not with a long one
        content["game"]["horizon"] = 1000
        refusal = "algorithm.rollouts 1000000: expected at most 99900 for horizon 1000; take fewer"
    assert refusal in refused(tmp_path, yaml.safe_dump(content))


def test_slots_that_can_never_connect_are_not_drawn() -> None:
    with pytest.raises(ScheduleError, match="2 slots of 1 random pairs never connected 1000 learners"):
        gossip(NAMES, 2, seed=0)


METADATA = "rosbag2_bagfile_information:\n  storage_identifier: {}\n  relative_file_paths: {}\n"


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        (METADATA.format("sqlite3", "[a.db3]"), "storage 'sqlite3', expected 'mcap'; convert the bag"),
        (METADATA.format("x" * 100_000, "[a]"), "... (100002 characters), expected 'mcap'"),
        (METADATA.format("mcap", "[../bag/bag_0.mcap]"), "expected different names of files beside it"),
        (METADATA.format("mcap", "[/etc/passwd]"), "['/etc/passwd'], expected different names of files beside it"),
        (METADATA.format("mcap", "[a.mcap, a.mcap]"), "expected different names of files beside it"),
        (METADATA.format("mcap", '["a\\0b"]'), "expected different names of files beside it"),
        (METADATA.format("mcap", "a.mcap"), "relative_file_paths 'a.mcap', expected different names of files"),
        (METADATA.format("mcap", "[1, 2]"), "relative_file_paths [1, 2], expected different names of files"),
        (METADATA.format("mcap", "[gone.mcap]"), "gone.mcap: cannot be read (No such file or directory)"),
        (METADATA.format("mcap", "[pipe]"), "pipe: is no file but a pipe or device"),
        (METADATA.format("mcap", "[directory]"), "directory: cannot be read (Is a directory)"),
        (METADATA.format("2001-13-45", "[a]"), "is not the metadata of a rosbag2 bag (month must be in 1..12)"),
        (MERGE_BOMB, "is not the metadata of a rosbag2 bag (<<: expected one mapping"),
        ("[" * 5000, "is not the metadata of a rosbag2 bag (maximum recursion depth exceeded"),
        ("{}", "is not the metadata of a rosbag2 bag ('rosbag2_bagfile_information')"),
    ],
    ids=lambda value: value[-40:],
)
def test_metadata_that_lead_nowhere_are_refused(experiment: Experiment, text: str, refusal: str) -> None:
    bag = experiment.demonstrations.bag
    os.mkfifo(bag / "pipe")
    (bag / "directory").mkdir()
    file = bag / "metadata.yaml"
    found = outcome(lambda: content_of(experiment), file, Example("", text.encode()), BagError)
    assert refusal in str(found)


def test_an_index_that_points_elsewhere_is_refused(experiment: Experiment) -> None:
    """Its chunks would be read without having been checked."""
    file = mcap_file(experiment.demonstrations.bag)
    content = rewritten(file.read_bytes(), "plain")
    place = content.index(b"\x06")  # the first chunk's record begins here, and the index says so
    wrong = content.replace(place.to_bytes(8, "little"), (place + 1).to_bytes(8, "little"))
    assert wrong != content
    found = outcome(lambda: content_of(experiment), file, Example("", wrong), BagError)
    assert "the index of its chunks differs from its chunks" in str(found)


def test_topics_with_odd_names_do_not_flood_the_error(experiment: Experiment) -> None:
    file = mcap_file(experiment.demonstrations.bag)
    content = rewritten(file.read_bytes(), "plain")
    odd = content.replace(b"/learner_1/demonstration", b"/\x1b[2J\n" + b"x" * 18)[:-40]
    found = outcome(lambda: content_of(experiment), file, Example("", odd), BagError)
    assert "topic /\\x1b[2J\\nxxx" in str(found)
    assert str(found).isprintable()


def test_no_lie_about_a_length_makes_a_reader_take_gigabytes(
    make_experiment: Callable[..., Path], tmp_path: Path
) -> None:
    """In a process that may not: honest files, damaged ones of every layout, and lies made by hand."""
    file = make_experiment()
    experiment = load_experiment(file)
    content = mcap_file(experiment.demonstrations.bag).read_bytes()
    expected = {}
    for number, (_, lie, refusal) in enumerate(lies(content)):
        expected[bag_of(tmp_path / f"lie_{number}", lie)] = refusal
    for layout in LAYOUTS:
        bag = rewritten(content, layout)
        expected[bag_of(tmp_path / layout, bag)] = "read"
        for number, case in enumerate(examples(bag, bag, 7, 12)):
            expected[bag_of(tmp_path / f"{layout}_{number}", case.content)] = ""
    for name, text in {"bomb": BOMB, "merge_bomb": MERGE_BOMB, "chain": LONG_CHAIN, "aliases": "a: *a"}.items():
        expected[tmp_path / name] = "refused: "
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = [sys.executable, str(Path(__file__).with_name("limited.py")), str(file), *map(str, expected)]
    finished = subprocess.run(command, capture_output=True, text=True, check=False, timeout=200)
    found = {Path(line["path"]): line["outcome"] for line in map(json.loads, finished.stdout.splitlines())}
    assert finished.returncode == 0, finished.stderr[-2000:]
    assert found.keys() == expected.keys()
    for path, text in expected.items():
        assert found[path] == "read" or found[path].startswith("refused: "), found[path]
        assert text in found[path], path


def bag_of(directory: Path, content: bytes) -> Path:
    directory.mkdir()
    (directory / "bag_0.mcap").write_bytes(content)
    (directory / "metadata.yaml").write_text(METADATA.format("mcap", "[bag_0.mcap]"), encoding="utf-8")
    return directory
