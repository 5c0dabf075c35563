"""What a run directory says of itself holds, and what was done to it is seen."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from identity import assert_same_histories

from mabirds_bringup.commands.report import check, report
from mabirds_bringup.commands.simulate import simulate, simulate_from_bag
from mabirds_bringup.evaluate import policies, results
from mabirds_bringup.evaluate.verdicts import Verdict
from mabirds_bringup.exit_codes import INCOMPLETE
from mabirds_bringup.run.stored_run import RunPlan, begin, find_run, load_run, locked, write_experiment
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.digest import arrays_digest
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment
from mabirds_learner.records import HEADER

CONFIG = Path(__file__).resolve().parents[3] / "ros_ws" / "config"


@pytest.fixture(scope="module")
def shared_run(make_shared_experiment: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = make_shared_experiment(iterations=6)
    out = tmp_path_factory.mktemp("runs")
    simulate(file, out=out)
    return (out / "latest").resolve()


@pytest.fixture
def directory(shared_run: Path, tmp_path: Path) -> Path:
    """A run directory that a test may damage."""
    return Path(shutil.copytree(shared_run, tmp_path / "copy"))


def summary_of(directory: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    return content


def test_a_whole_run_is_certified(directory: Path) -> None:
    summary, run = summary_of(directory), load_run(directory)
    history = simulate_from_bag(run.experiment)
    assert (summary["complete"], summary["missing"]) == (True, [])
    assert summary["last_iterations"] == {"learner_1": 7, "learner_2": 7}
    assert summary["parameters_digest"] == {name: arrays_digest(known[-1]) for name, known in history.items()}
    assert summary["bag_digest"] == run.bag_digest
    with run.open_history() as kept:
        assert_same_histories(kept.without_gap(), history)
    assert check(directory) == 0


def test_a_run_may_be_evaluated_later(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    """With the same result, to the last bit; the time that it took is kept."""
    file = make_experiment(iterations=4)
    for name, evaluation in (("at_once", True), ("later", False)):
        simulate(file, out=tmp_path / name, evaluation=evaluation)
    later = (tmp_path / "later" / "latest").resolve()
    before = summary_of(later)
    assert (before["complete"], "learners" in before, (later / "report.html").exists()) == (True, False, False)
    assert check(later) == 0
    assert report([later]) == 0
    assert summary_of(later) == {**summary_of(tmp_path / "at_once" / "latest"), "wall_seconds": before["wall_seconds"]}
    assert (later / "metrics.csv").read_bytes() == (tmp_path / "at_once" / "latest" / "metrics.csv").read_bytes()


def test_what_learners_ended_with_is_told_before_others_judge_it(
    make_drone_experiment: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Verdicts take long; whoever does not wait for them has rates, and `mabirds report` asks for them later."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(policies, "verdict", interrupted)
        with pytest.raises(KeyboardInterrupt):
            simulate(make_drone_experiment(iterations=3), out=tmp_path)
    directory = (tmp_path / "latest").resolve()
    before = summary_of(directory)
    assert (before["complete"], before["to_be_judged"], before["learners"]["learner_1"]["judges"]) == (True, 12, {})
    monkeypatch.setattr(policies, "verdict", lambda *_: Verdict(0.1, 0.9, 0.0, 0.0, 1.0, None))
    assert (check(directory), report([directory]), check(directory)) == (INCOMPLETE, 0, 0)
    assert "summary.json lacks 12 policies that were to be judged" in capfd.readouterr().err
    after = summary_of(directory)
    assert "to_be_judged" not in after
    for name, learner in after["learners"].items():
        assert len(learner["judges"]) == 3
        for rate in ("violation_rate", "success_rate", "held_out_log_likelihood", "occupancy_distance"):
            assert before["learners"][name][rate] == learner[rate]


def a_record_is_gone(directory: Path) -> None:
    file = directory / "parameters" / "learner_2.log"
    content = bytearray(file.read_bytes())
    size = (len(content) - HEADER) // 7
    content[HEADER + 3 * size : HEADER + 4 * size] = bytes(size)
    file.write_bytes(content)


def last_parameters_were_changed(directory: Path) -> None:
    with load_run(directory).open_history() as kept:
        theta, omega = kept.parameters["learner_1"][7]
        kept.parameters["learner_1"][7] = Parameters(theta, np.nextafter(omega, 1.0))


def the_summary_was_changed(directory: Path) -> None:
    content = summary_of(directory)
    content["last_iterations"]["learner_1"] = 8
    (directory / "summary.json").write_text(json.dumps(content), encoding="utf-8")


def there_is_no_summary(directory: Path) -> None:
    (directory / "summary.json").unlink()


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (a_record_is_gone, "learner_2: iterations 4 of 7 are not known"),
        (last_parameters_were_changed, "summary.json has parameters_digest"),
        (the_summary_was_changed, "summary.json has last_iterations"),
        (there_is_no_summary, "there is no summary.json"),
    ],
)
def test_damage_is_found(
    directory: Path, capfd: pytest.CaptureFixture[str], damage: Callable[[Path], None], words: str
) -> None:
    damage(directory)
    assert check(directory) == 5
    assert words in capfd.readouterr().err


def test_a_report_of_what_is_left_says_that_it_is_incomplete(directory: Path) -> None:
    a_record_is_gone(directory)
    assert report([directory]) == 5
    summary = summary_of(directory)
    assert summary["complete"] is False
    assert summary["learners"]["learner_2"]["iterations"] == 2
    assert "Incomplete" in (directory / "report.html").read_text(encoding="utf-8")


def test_an_interrupted_evaluation_keeps_what_was_judged(
    directory: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    before = summary_of(directory)
    (directory / "metrics.csv").unlink()
    judged = list[Any]()

    def interrupted(*arguments: Any) -> Any:
        experiment, history, demonstrations, on_row, known, judge, _ = arguments
        assert [row.iteration for row in known] == judged

        def on_each(row: Any) -> None:
            on_row(row)
            judged.append(row.iteration)
            if len(judged) == 3:
                raise KeyboardInterrupt

        return evaluate(experiment, history, demonstrations, on_each, known, judge)

    evaluate = results.evaluate
    monkeypatch.setattr(results, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        report([directory])
    assert judged == [1, 2, 3]
    assert report([directory]) == 0
    assert summary_of(directory) == before


@pytest.mark.parametrize("file", sorted(CONFIG.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_written_experiment_is_the_same_one(file: Path, tmp_path: Path) -> None:
    before = load_experiment(file)
    write_experiment(tmp_path / "experiment.yaml", before)
    assert load_experiment(tmp_path / "experiment.yaml") == before


def test_an_experiment_that_was_changed_afterwards_is_refused(directory: Path) -> None:
    file = directory / "experiment.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    file.write_text(yaml.safe_dump({**content, "seed": 4}), encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"digest of the experiment .* one of the files was changed"):
        load_run(directory)


def test_what_is_no_run_directory_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match=r"manifest.json: cannot be read .*; give a run directory"):
        load_run(tmp_path)
    (tmp_path / "manifest.json").write_text("[]", encoding="utf-8")
    with pytest.raises(ExperimentError, match="expected an object"):
        load_run(tmp_path)


def test_a_run_is_found_by_its_name_nodes_and_experiment(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file, out = make_experiment(), tmp_path / "runs"
    experiment = load_experiment(file)
    plan = RunPlan("monday", only=("learner_1",))
    assert find_run(out, experiment, plan) is None
    made = begin(out, experiment, file, bag_digest=None, plan=plan, method=None)
    found = find_run(out, experiment, plan)
    assert found
    assert (found.directory, found.plan.run, found.bag_digest) == (made.directory, "monday", None)
    assert find_run(out, experiment, RunPlan("monday", only=("learner_2",))) is None
    assert find_run(out, experiment, RunPlan("tuesday", only=("learner_1",))) is None
    with pytest.raises(ExperimentError, match="monday: .* is a run of this name with another experiment"):
        find_run(out, experiment.model_copy(update={"seed": 4}), plan)


def test_two_supervisors_of_one_directory_are_refused(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(ExperimentError, match="another `mabirds run` is at work"), locked(tmp_path):
        pass
    with locked(tmp_path):
        pass
