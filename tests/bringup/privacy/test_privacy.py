"""What parameters reveal: private demonstrations are rebuilt, by the paper's steps and by the default rule alike."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mabirds_bringup.commands.audit import privacy
from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate, simulate_from_bag
from mabirds_bringup.privacy.attack import rebuild
from mabirds_bringup.privacy.audit import audit, compared
from mabirds_bringup.privacy.decoding import Decoder
from mabirds_core.algorithm.gradient import Counts, GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.games.interface import discounted_visitation
from mabirds_expert_player.recorder import record

PAPER: dict[str, Any] = {"steps": {"alpha": 48.0, "beta": 12.0}, "window": 1}
SAMPLED: dict[str, Any] = {**PAPER, "expectation": "sampled", "rollouts": 20}
DEFAULT: dict[str, Any] = {}
SOFT: dict[str, Any] = {"bag": "bag", "per_learner": 12, "experts": "soft", "seed": 5}
MANY_STARTS: dict[str, Any] = {
    "kind": "patrol",
    "map": "....\n.##.\n....",
    "starts": [[[0, 0], [2, 3]], [[0, 1], [2, 2]], [[0, 3], [2, 0]]],
    "goals": [[2, 3], [0, 0]],
    "horizon": 9,
}


@pytest.fixture
def make(make_experiment: Callable[..., Path]) -> Callable[..., Experiment]:
    def one(algorithm: dict[str, Any], **change: Any) -> Experiment:
        changes = {"algorithm": algorithm, "demonstrations": SOFT, **change}
        return load_experiment(make_experiment(iterations=12, change=changes))

    return one


@pytest.mark.parametrize(
    ("algorithm", "change", "least"),
    [
        (PAPER, {}, 0.95),
        (SAMPLED, {}, 0.95),
        ({**PAPER, "window": 4}, {}, 0.95),
        (DEFAULT, {}, 0.45),  # steps that are as long as they can be tell no more than the least of a count
        (PAPER, {"game": MANY_STARTS}, 0.6),  # a step of nothing does not tell where it began
        (DEFAULT, {"game": MANY_STARTS}, 0.6),
    ],
    ids=["paper", "sampled", "window of 4", "default", "paper, starts", "default, starts"],
)
def test_private_demonstrations_are_rebuilt(
    make: Callable[..., Experiment], algorithm: dict[str, Any], change: dict[str, Any], least: float
) -> None:
    experiment = make(algorithm, **change)
    found = audit(experiment, simulate_from_bag(experiment), demonstrations_of(experiment))
    assert {name: revealed.demonstrations for name, revealed in found.items()} == {"learner_1": 12, "learner_2": 12}
    assert min(revealed.steps for revealed in found.values()) >= least


def test_the_command_audits_a_run_directory(
    make_experiment: Callable[..., Path], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    file = make_experiment(change={"algorithm": PAPER, "demonstrations": SOFT}, iterations=6)
    simulate(file, out=tmp_path / "runs")
    privacy(tmp_path / "runs" / "latest")
    assert "learner_2: 100.0% of the steps rebuilt, 6 of 6 demonstrations in every step" in capfd.readouterr().err


def test_the_attack_sees_nothing_of_others_parameters_that_are_noise(make: Callable[..., Experiment]) -> None:
    """Else the test above would pass for a decoder that guesses well."""
    experiment = make(PAPER)
    history, rng = simulate_from_bag(experiment), np.random.default_rng(1)
    noisy = {
        name: [Parameters(*(values + rng.normal(scale=1.0, size=values.shape) for values in known)) for known in series]
        for name, series in history.items()
    }
    assert all(guess is None for guess in rebuild(experiment, "learner_1", noisy))


def test_counts_lead_to_one_trajectory(make: Callable[..., Experiment]) -> None:
    experiment = make(DEFAULT)
    game = build_game(experiment)
    for trajectory in demonstrations_of(experiment)["learner_1"]:
        counts = game.cost_features.total(discounted_visitation(trajectory, game.discount))
        found = Decoder(game).steps(counts, int(trajectory.states[0, 0]))
        assert found is not None
        assert found.tolist() == trajectory.states[0].tolist()
        assert Decoder(game).steps(counts + 0.01, int(trajectory.states[0, 0])) is None


@pytest.mark.parametrize("algorithm", [PAPER, DEFAULT])
def test_a_step_undone_is_what_was_demonstrated(make: Callable[..., Experiment], algorithm: dict[str, Any]) -> None:
    learner, rng = build_learner(make(algorithm), "learner_1"), np.random.default_rng(2)
    imagined = Parameters(rng.random(5), rng.random(4))

    def drawn() -> Parameters:
        """Counts of which one is never demonstrated, as there always is."""
        return Parameters(rng.random(5), np.array([0.0, *rng.random(3)]))

    observed = drawn()
    state = learner.steps.initial(imagined)
    for n in range(1, 30):
        estimate = GradientEstimate(imagined, observed, None, Counts(theta=True, omega=True), 2.0, 1.0)
        step, after = learner.steps.step(state, estimate, n)
        blind = estimate._replace(observed=Parameters(np.full(5, np.nan), np.full(4, np.nan)))
        found, remembered = learner.steps.reveal(state, step, blind, n)  # type: ignore[attr-defined]
        for told, shown, done in zip(found, observed, imagined, strict=True):
            bounded = (shown > done) if algorithm == DEFAULT else np.zeros(len(shown), dtype=np.bool_)
            np.testing.assert_allclose(told[~bounded], shown[~bounded], atol=1e-9)
            assert (told <= shown + 1e-9).all()
        assert all(np.array_equal(remembered[name], values) for name, values in after.items())
        state, observed = after, drawn()


def test_rests_tell_themselves_and_do_not_count() -> None:
    shown = [np.array([1, 2, 3, 3, 3]), np.array([1, 1])]
    assert compared([np.array([1, 2, 3, 9, 9]), None], shown) == (2, 1, 3 / 4)
    assert compared([np.array([1, 9, 3, 3, 3]), np.array([1, 9])], shown) == (2, 1, 3 / 4)


def test_omega_alone_is_enough(make: Callable[..., Experiment]) -> None:
    """Theta is a network's."""
    experiment = make({**PAPER, "reward": {"kind": "neural", "hidden": 4}})
    found = audit(experiment, simulate_from_bag(experiment), demonstrations_of(experiment))
    assert min(revealed.steps for revealed in found.values()) >= 0.95


@pytest.mark.parametrize(
    ("algorithm", "change", "words"),
    [
        (DEFAULT, {"mixing": {"kind": "resilient"}}, "mixing is resilient"),
        ({"cost": {"kind": "network"}}, {}, "this audit is of linear costs"),
    ],
    ids=["resilient", "network"],
)
def test_where_it_is_no_attack_it_says_so(
    make: Callable[..., Experiment], algorithm: dict[str, Any], change: dict[str, Any], words: str
) -> None:
    with pytest.raises(ExperimentError, match=words):
        rebuild(make(algorithm, **change), "learner_1", {})


DISCRETE = Path(__file__).resolve().parents[3] / "ros_ws" / "config" / "discrete.yaml"
SECURITY = Path(__file__).resolve().parents[3] / "docs" / "security.md"


@pytest.mark.parametrize("algorithm", [PAPER, DEFAULT], ids=["paper", "default"])
def test_of_the_papers_game_documents_say_what_is_rebuilt(tmp_path: Path, algorithm: dict[str, Any]) -> None:
    """Its first demonstrations; the whole of it takes half a minute."""
    content = yaml.safe_load(DISCRETE.read_text(encoding="utf-8"))
    content["demonstrations"] |= {"bag": "bag", "per_learner": 8}
    (tmp_path / "experiment.yaml").write_text(
        yaml.safe_dump({**content, "algorithm": algorithm, "iterations": 8}), encoding="utf-8"
    )
    experiment = load_experiment(tmp_path / "experiment.yaml")
    record(experiment, experiment.demonstrations.bag)
    found = audit(experiment, simulate_from_bag(experiment), demonstrations_of(experiment))
    assert min(revealed.steps for revealed in found.values()) >= (0.95 if algorithm else 0.3)
    row = "the paper's, window 1 | 100.0 % | 40 of 40" if algorithm else "the default | 87.2 %, 89.3 % | 35, 36 of 40"
    assert f"| {row} |" in SECURITY.read_text(encoding="utf-8")
