"""Experiment files: the shipped one loads, wrong ones are refused by file, place and value; digests."""

import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml
from experiments import SETTINGS, changed, experiment
from pydantic import ValidationError, create_model

from mabirds_core.arithmetic import arithmetic
from mabirds_core.consensus.generators import alternating_ring, complete_edges, ring_edges, static
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.games.patrol.settings import PatrolSettings

REPOSITORY = Path(__file__).resolve().parents[3]
PATROL = REPOSITORY / "ros_ws" / "config" / "patrol.yaml"
NAMES = ("ann", "bob", "cid")


def write(directory: Path, content: dict[str, Any]) -> Path:
    file = directory / "experiment.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def refusal(file: Path) -> str:
    """The message with which the file is refused, without the file's name that must open it."""
    with pytest.raises(ExperimentError) as caught:
        load_experiment(file)
    opening, _, rest = str(caught.value).partition(f"{file}: ")
    assert opening == ""
    assert rest
    return rest


def test_the_shipped_patrol_experiment_loads() -> None:
    loaded = load_experiment(PATROL)
    assert loaded.name == "patrol"
    assert loaded.learners == ("learner_1", "learner_2")
    assert loaded.edge_schedule == alternating_ring(loaded.learners)
    assert loaded.game.n_experts == 2
    assert loaded.iterations <= loaded.demonstrations.per_learner


def test_the_bag_is_found_relative_to_the_experiment_file() -> None:
    assert load_experiment(PATROL).demonstrations.bag == REPOSITORY / "bags" / "patrol"


def test_a_written_experiment_is_read_back(tmp_path: Path) -> None:
    loaded = load_experiment(write(tmp_path, SETTINGS))
    assert loaded.demonstrations.bag == tmp_path.resolve() / "bag"
    expected = experiment({"demonstrations.bag": str(tmp_path.resolve() / "bag")})
    assert loaded.model_dump() == expected.model_dump()


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    message = refusal(tmp_path / "nowhere.yaml")
    reason = "cannot be read (No such file or directory)"
    assert message == f"{reason}; give the path of an experiment file"


def test_a_directory_is_refused_by_name(tmp_path: Path) -> None:
    assert refusal(tmp_path).startswith("cannot be read (Is a directory)")


@pytest.mark.parametrize(
    "content", [b"game: [1, 2", b"a: b: c", b"\xff\xfe\x00broken", b"!!python/object:os.system {}"]
)
def test_what_is_not_yaml_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_bytes(content)
    assert refusal(file).startswith("is not YAML: ")


@pytest.mark.parametrize(("content", "found"), [("", "NoneType"), ("- a\n- b", "list"), ("words", "str")])
def test_yaml_that_holds_no_settings_is_refused(tmp_path: Path, content: str, found: str) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(content, encoding="utf-8")
    assert refusal(file) == f"expected the settings of an experiment, found {found}"


SLOTS = {"kind": "slots", "slots": [[["ann", "bob"], ["bob", "ann"]]]}


@pytest.mark.parametrize(
    ("changes", "place", "value"),
    [
        ({"colour": "red"}, "colour", "'red'"),
        ({"game.gravity": 9}, "game.gravity", "9"),
        ({"algorithm.steps.gamma": 0.5}, "algorithm.steps.paper.gamma", "0.5"),
        ({"schedule": {"kind": "static", "graph": "ring", "speed": 2}}, "schedule.static.speed", "2"),
        ({"name": "Tiny Name"}, "name", "'Tiny Name'"),
        ({"iterations": "many"}, "iterations", "'many'"),
        ({"iterations": 0}, "iterations", "0"),
        ({"iterations": 2.5}, "iterations", "2.5"),
        ({"seed": -1}, "seed", "-1"),
        ({"constraint_threshold": -0.5}, "constraint_threshold", "-0.5"),
        ({"constraint_threshold": float("nan")}, "constraint_threshold", "nan"),
        ({"learners": ["ann", "Bob"]}, "learners.1", "'Bob'"),
        ({"learners": "ann"}, "learners", "'ann'"),
        (
            {"learners": ["ann", "ann"]},
            "experiment",
            "learners ['ann', 'ann']: expected at least one, each named once",
        ),
        ({"learners": []}, "learners", "at least 1 item"),
        ({"game.horizon": 0}, "game.horizon", "0"),
        ({"game.discount": 1.5}, "game.discount", "1.5"),
        ({"game.map": "..\n."}, "game.map", "'..\\n.'"),
        ({"game.starts": [[[1, 1], [0, 2]]]}, "game", "(1, 1)"),
        ({"game.starts": [[[0, "left"], [0, 2]]]}, "game.starts.0.0.1", "'left'"),
        ({"algorithm.window": 0}, "algorithm.window", "0"),
        ({"algorithm.rollouts": 0}, "algorithm.rollouts", "0"),
        ({"algorithm.expectation": "guessed"}, "algorithm.expectation", "'guessed'"),
        ({"algorithm.reward": {"kind": "deep"}}, "algorithm.reward", "deep"),
        ({"algorithm.steps.alpha": 0}, "algorithm.steps.paper.alpha", "0"),
        ({"algorithm.steps.eta1": 0.5}, "algorithm.steps.paper.eta1", "0.5"),
        ({"algorithm.steps.eta2": "fast"}, "algorithm.steps.paper.eta2", "'fast'"),
        ({"schedule": {"kind": "psychic"}}, "schedule", "'psychic'"),
        ({"schedule": {"kind": "static", "graph": "star"}}, "schedule.static.graph", "'star'"),
        ({"schedule": {"kind": "slots", "slots": []}}, "schedule.slots.slots", "at least 1 item"),
        ({"schedule": {"kind": "slots", "slots": [[["ann", "dan"]]]}}, "schedule", "'dan'"),
        ({"schedule": SLOTS}, "experiment", "ann knows ever reaches cid"),
        ({"schedule": {"kind": "slots", "slots": [[["ann", "bob"]]]}}, "experiment", "ann -> bob"),
        ({"demonstrations.per_learner": 0}, "demonstrations.per_learner", "0"),
        ({"demonstrations.period": 0}, "demonstrations.period", "0"),
        ({"demonstrations.seed": "lucky"}, "demonstrations.seed", "'lucky'"),
    ],
    ids=lambda value: str(value)[:50] if isinstance(value, dict) else "",
)
def test_a_wrong_setting_is_refused_by_place_and_value(
    tmp_path: Path, changes: dict[str, Any], place: str, value: str
) -> None:
    message = refusal(write(tmp_path, changed(changes)))
    assert f"{place}: " in message
    assert value in message


def test_merge_keys_are_no_repetition(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    text = yaml.safe_dump({key: value for key, value in SETTINGS.items() if key != "algorithm"})
    file.write_text(
        f"{text}algorithm:\n  <<: {{rollouts: 5, window: 2}}\n  rollouts: 7\n  steps: {{alpha: 1, beta: 1}}\n"
    )
    settings = load_experiment(file).algorithm
    assert (settings.rollouts, settings.window) == (7, 2)


def test_bottomless_yaml_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text("[" * 5000)
    assert "is not YAML" in refusal(file)
    file.write_text("name: &again [*again]\n")
    assert refusal(file)


@pytest.mark.parametrize("name", ["expert_player", "demonstration"])
def test_names_of_other_parts_are_no_learners(tmp_path: Path, name: str) -> None:
    assert f"['{name}'] is taken by another part" in refusal(write(tmp_path, changed({"learners": ["ann", name]})))


def test_runs_of_one_experiment_have_digests_of_their_own() -> None:
    one = experiment()
    assert one.run_digest("") == one.digest
    assert len({one.run_digest(run) for run in ("", "monday", "tuesday")}) == 3


def test_a_setting_written_twice_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, SETTINGS)
    file.write_text(file.read_text(encoding="utf-8") + "seed: 4\n", encoding="utf-8")
    assert "'seed' is set twice" in refusal(file)


@pytest.mark.parametrize(
    ("place", "value", "expectation"),
    [
        ("seed", True, "seed: Input should be a valid integer (given: True)"),
        ("iterations", "12", "iterations: Input should be a valid integer (given: '12')"),
        ("iterations", 13, "iterations 13: expected at most demonstrations.per_learner, 12"),
    ],
)
def test_settings_are_strict_about_types_and_sizes(tmp_path: Path, place: str, value: object, expectation: str) -> None:
    assert expectation in refusal(write(tmp_path, changed({place: value})))


def test_a_game_too_large_to_tabulate_is_refused(tmp_path: Path) -> None:
    cells = [[0, 0], [0, 1], [0, 2], [0, 3]]
    game = {"map": "\n".join(["." * 7] * 7), "starts": [cells], "goals": cells[::-1], "horizon": 9}
    text = refusal(write(tmp_path, changed({"game": game})))
    assert "4 experts on a 7x7 map make 1.5e+09 joint state-action pairs, expected at most 2e+07" in text


@pytest.mark.parametrize("key", [key for key in SETTINGS if key not in {"seed", "algorithm", "constraint_threshold"}])
def test_a_missing_setting_is_refused_by_place(tmp_path: Path, key: str) -> None:
    content = {name: value for name, value in SETTINGS.items() if name != key}
    assert refusal(write(tmp_path, content)) == f"{key}: Field required"


def test_every_wrong_setting_is_named_at_once(tmp_path: Path) -> None:
    message = refusal(write(tmp_path, changed({"iterations": -4, "game.horizon": -5, "colour": "red"})))
    assert message.count("; ") == 2
    for part in ("iterations: ", "(given: -4)", "game.horizon: ", "(given: -5)", "colour: "):
        assert part in message


@pytest.mark.parametrize("name", ["alpha", "beta"])
def test_an_infinite_step_size_is_refused_by_place(tmp_path: Path, name: str) -> None:
    message = refusal(write(tmp_path, changed({f"algorithm.steps.{name}": float("inf")})))
    assert f"algorithm.steps.paper.{name}: " in message


@pytest.mark.parametrize(
    "changes",
    [
        {"game.horizon": 5},
        {"game.map": "...\n..."},
        {"seed": 4},
        {"learners": ["ann", "bob"]},
        {"learners": ["bob", "ann", "cid"]},
        {"algorithm.window": 2},
        {"algorithm.rollouts": 6},
        {"algorithm.expectation": "exact"},
        {"algorithm.steps.eta1": 0.6},
    ],
    ids=str,
)
def test_the_digest_changes_with_what_decides_the_parameters(changes: dict[str, Any]) -> None:
    assert experiment(changes).digest != experiment().digest


@pytest.mark.parametrize(
    "changes",
    [{"demonstrations.bag": "elsewhere/bag"}, {"name": "other"}, {"constraint_threshold": 0.2}],
    ids=str,
)
def test_the_digest_does_not_change_with_what_does_not(changes: dict[str, Any]) -> None:
    assert experiment(changes).digest == experiment().digest


def test_an_option_that_comes_to_be_later_changes_no_digest() -> None:
    later = create_model("Later", __base__=Experiment, novelty=(int, 3))
    game = create_model("LaterGame", __base__=PatrolSettings, wind=(float, 0.0))
    content = changed({})
    assert later.model_validate(content).digest == experiment().digest
    windy = experiment().model_copy(update={"game": game.model_validate(content["game"])})
    assert windy.digest == experiment().digest
    assert windy.model_copy(update={"game": windy.game.model_copy(update={"wind": 1.0})}).digest != experiment().digest


def test_an_option_of_a_method_that_no_learner_uses_changes_no_digest() -> None:
    assert experiment({"baselines": {"ftl": {"tolerance": 0.31}}}).digest == experiment().digest


def test_digests_say_of_which_format_they_are() -> None:
    assert experiment().digest.startswith(f"v4-{arithmetic()}-")
    assert experiment().run_digest("monday").startswith(f"v4-{arithmetic()}-")


def test_the_digest_does_not_depend_on_where_the_file_is(tmp_path: Path) -> None:
    here = write(tmp_path, SETTINGS)
    there = tmp_path / "below" / "copy.yaml"
    there.parent.mkdir()
    shutil.copy(here, there)
    assert load_experiment(here).digest == load_experiment(there).digest


def test_a_changed_copy_has_the_digest_of_its_own_settings() -> None:
    original = experiment()
    before = original.digest
    copy = original.model_copy(update={"seed": 4})
    assert copy.digest == experiment({"seed": 4}).digest != before


def test_a_changed_copy_has_the_schedule_of_its_own_settings() -> None:
    copy = experiment().model_copy(update={"learners": ("ann", "bob")})
    assert copy.edge_schedule.learners == ("ann", "bob")


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"kind": "static"}, static(NAMES, complete_edges(3))),
        ({"kind": "static", "graph": "ring"}, static(NAMES, ring_edges(3))),
        ({"kind": "alternating"}, alternating_ring(NAMES)),
        (
            {"kind": "slots", "slots": [[["ann", "bob"], ["bob", "cid"]]], "undirected": True},
            static(NAMES, [(0, 1), (1, 2)]),
        ),
    ],
    ids=["complete", "ring", "alternating", "slots"],
)
def test_schedules_are_built_from_their_settings(settings: dict[str, Any], expected: object) -> None:
    assert experiment({"schedule": settings}).edge_schedule == expected


def test_explicit_slots_are_directed_from_sender_to_receiver() -> None:
    ring = [["ann", "bob"], ["bob", "cid"], ["cid", "ann"]]
    schedule = experiment({"schedule": {"kind": "slots", "slots": [ring, []]}}).edge_schedule
    assert schedule.slots == (frozenset({(0, 1), (1, 2), (2, 0)}), frozenset())


def test_an_unknown_learner_has_no_index() -> None:
    assert [experiment().index_of(name) for name in NAMES] == [0, 1, 2]
    with pytest.raises(ExperimentError, match=r"'dan' is none of the learners \['ann', 'bob', 'cid'\]"):
        experiment().index_of("dan")


def test_an_experiment_cannot_be_changed() -> None:
    loaded: Any = experiment()
    with pytest.raises(ValidationError, match="frozen"):
        loaded.seed = 4
    assert isinstance(loaded, Experiment)
