"""Settings of a kind are checked by its own model, and refused in the words of all kinds of the group."""

import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from experiments import changed
from pydantic import BaseModel, TypeAdapter, ValidationError

from mabirds_core.experiment.file import Experiment
from mabirds_core.kind_settings import settings_of
from mabirds_core.registry import GROUPS, METHODS, kinds, union

PLANNERS, SCHEDULES, STEPS = "mabirds.planners", "mabirds.schedules", "mabirds.step_rules"
FEATURES = "mabirds.cost_features"
"""Stand beside texts, and are another union."""

SOFT_Q = {"kind": "soft_q_learning", "episodes": 7}
CASES = [
    (PLANNERS, SOFT_Q),
    (PLANNERS, {**SOFT_Q, "episodes": "7"}),
    (PLANNERS, {**SOFT_Q, "episodes": 0, "sweeps": True}),
    (PLANNERS, {**SOFT_Q, "mispelt": 1}),
    (PLANNERS, {"kind": "magic"}),
    (PLANNERS, {"kind": 3}),
    (PLANNERS, {"kind": ["soft_q_learning"]}),
    (PLANNERS, {}),
    (PLANNERS, None),
    (PLANNERS, "soft_q_learning"),
    (PLANNERS, [SOFT_Q]),
    (SCHEDULES, {"kind": "slots", "slots": [[["a", "b"]]]}),
    (SCHEDULES, {"kind": "slots", "slots": [[["a", "B"]], [["a"]]]}),
    (SCHEDULES, {"kind": "gossip", "slots": 3}),
    (STEPS, {"alpha": 1, "beta": 1}),
    (STEPS, {"kind": "paper", "alpha": -1, "beta": float("inf")}),
    (STEPS, {"kind": "adaptive", "alpha": 1}),
]


def outcome(kind: Any, given: Any, how: str) -> Any:
    """The settings, or every error with its place."""
    adapter = TypeAdapter(kind)
    try:
        if how == "python":
            return adapter.validate_python(given)
        return adapter.validate_json(json.dumps(given), strict=how == "strict")
    except ValidationError as error:
        return error.errors(include_url=False)


@pytest.mark.parametrize("how", ["python", "json", "strict"])
@pytest.mark.parametrize(("group", "given"), CASES, ids=str)
def test_they_are_read_and_refused_as_by_all_kinds_at_once(group: str, given: Any, how: str) -> None:
    found, expected = outcome(settings_of(group), given, how), outcome(union(group), given, how)
    assert found == expected
    assert type(found) is type(expected)


def test_some_of_these_are_read_and_some_refused() -> None:
    read = [isinstance(outcome(settings_of(group), given, "strict"), BaseModel) for group, given in CASES]
    assert 3 <= sum(read) <= len(read) - 3


@pytest.mark.parametrize(("group", "given"), [CASES[0], CASES[11]], ids=str)
def test_settings_that_are_there_already_are_taken_and_written_as_they_are(group: str, given: Any) -> None:
    settings = outcome(union(group), given, "strict")
    adapter = TypeAdapter(settings_of(group))
    assert adapter.validate_python(settings) is settings
    for mode in ("python", "json"):
        assert adapter.dump_python(settings, mode=mode) == settings.model_dump(mode=mode)


@pytest.mark.parametrize("group", sorted({*GROUPS} - {METHODS, FEATURES}))
def test_json_schemas_say_all_kinds(group: str) -> None:
    schema = TypeAdapter(settings_of(group)).json_schema()
    assert all(kind.settings.__name__ in json.dumps(schema) for kind in kinds(group).values())


def test_the_schema_of_an_experiment_can_be_had() -> None:
    assert {"DroneSettings", "PatrolSettings", "FtlSettings"} <= Experiment.model_json_schema()["$defs"].keys()


def test_an_error_stands_where_it_stood() -> None:
    with pytest.raises(ValidationError) as caught:
        Experiment.model_validate(changed({"game.horizon": 0, "algorithm.policy": {**SOFT_Q, "sweeps": 0}}))
    places = [problem["loc"] for problem in caught.value.errors()]
    assert places == [("game", "patrol", "horizon"), ("algorithm", "policy", "soft_q_learning", "sweeps")]


def test_an_experiment_that_another_process_has_read_has_the_same_digest(tmp_path: Path) -> None:
    """As where judging is shared out: nothing has been checked there."""
    experiment = Experiment.model_validate(changed({"algorithm.policy": SOFT_Q}))
    (tmp_path / "experiment").write_bytes(pickle.dumps(experiment))
    program = "import pickle, sys\nprint(pickle.load(sys.stdin.buffer).digest)"
    with (tmp_path / "experiment").open("rb") as pickled:
        done = subprocess.run(
            [sys.executable, "-c", program], stdin=pickled, capture_output=True, text=True, check=True
        )
    assert done.stdout.split() == [experiment.digest]
