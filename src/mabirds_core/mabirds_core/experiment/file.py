"""An experiment file: the one typed, validated source of truth for game, algorithm, learners, schedule and bag."""

import json
import math
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from mabirds_core.consensus.schedule import EdgeSchedule, validate
from mabirds_core.consensus.schedule_settings import LearnerName, ScheduleSettings
from mabirds_core.consensus.settings import MixingSettings, StrictMixing
from mabirds_core.digest import digest
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.learning_settings import (
    AlgorithmSettings,
    BaselineSettings,
    LatticeSettings,
    SoftActorCriticSettings,
    SoftQSettings,
)
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.patrol.game import PatrolSettings
from mabirds_core.settings import Settings
from mabirds_core.texts import printable, shortened
from mabirds_core.yaml_files import LARGEST_FILE, read_yaml

LONGEST_VALUE = 60
"""Characters of a wrong value that an error shows."""

MOST_STEPS = 100_000_000
"""Steps of all trajectories that are rolled out at once: some gigabytes."""

MOST_CHARACTERS = 4 * LARGEST_FILE
"""Of an experiment's settings as JSON."""

LONGEST_EXPLANATION = 500
"""Characters that say what is wrong with one setting."""

LONGEST_ERROR = 4000
"""Characters of an error, however many settings are wrong."""

MOST_VALUES = 200_000_000
"""Values that a policy on a lattice may keep, and weights of where moves lead: 1.6 gigabytes each."""

MOVES = 25
"""Of a drone on a lattice."""

CHOICES: dict[str, dict[str, tuple[str, ...]]] = {
    "patrol": {
        "algorithm.policy.kind": ("soft_value_iteration", "soft_q_learning"),
        "algorithm.expectation": ("sampled", "exact"),
        "demonstrations.experts": ("optimal", "soft"),
    },
    "drones": {
        "algorithm.policy.kind": ("lattice", "soft_actor_critic"),
        "algorithm.expectation": ("sampled",),
        "demonstrations.experts": ("pilots",),
    },
}
"""What each kind of game leaves to choose."""

RESERVED_NAMES = {"expert_player", "demonstration"}
"""The player's name, and what a status says when a demonstration is missing."""


def game_kind(settings: Any) -> str:
    """Which game is meant; files without ``kind`` mean patrols."""
    kind = settings.get("kind", "patrol") if isinstance(settings, dict) else getattr(settings, "kind", "patrol")
    return str(kind)


GameSettings = Annotated[
    Annotated[PatrolSettings, Tag("patrol")] | Annotated[DroneSettings, Tag("drones")], Discriminator(game_kind)
]


PassingSide = Literal["by_start", "random", "left", "right"]
"""The side of a pillar on which pilots pass: where they started from it, either, or the same for all."""


class DemonstrationSettings(Settings):
    """Where the recorded demonstrations are, and how they are recorded."""

    bag: Path = Field(description="rosbag2 directory, relative to the experiment file")
    per_learner: int = Field(40, ge=1, le=1_000_000, description="demonstrations per learner")
    period: float = Field(1.0, gt=0, le=86_400, description="seconds between two demonstrations in the recording")
    experts: Literal["optimal", "soft", "pilots"] = Field(
        "optimal", description="least cost, maximum entropy, or pilots of drones"
    )
    side: PassingSide = Field("by_start", description="on which side pilots pass, or what decides")
    seed: int = Field(0, ge=0, description="of the experts' choices")


class Experiment(Settings):
    """One experiment; see ros_ws/config for commented examples."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")
    game: GameSettings
    algorithm: AlgorithmSettings
    learners: tuple[LearnerName, ...] = Field(min_length=1, max_length=1000)
    schedule: ScheduleSettings
    mixing: MixingSettings = Field(StrictMixing(), discriminator="kind", description="strict, or resilient to loss")
    demonstrations: DemonstrationSettings
    baselines: BaselineSettings = BaselineSettings()
    iterations: int = Field(ge=1, le=1_000_000, description="updates a learner makes, one demonstration each")
    closing_rounds: int = Field(0, ge=0, le=10_000, description="rounds of averaging alone, after the last update")
    seed: int = Field(0, ge=0, description="of the learners' rollouts")
    constraint_threshold: float = Field(ge=0, description="a constraint is learned where -omega exceeds this")

    @model_validator(mode="after")
    def _fits_together(self) -> "Experiment":
        if reserved := RESERVED_NAMES & set(self.learners):
            raise ExperimentError(f"learners: {sorted(reserved)} is taken by another part; choose another name")
        validate(self.edge_schedule)
        self.edge_schedule.edges(self.iterations + self.closing_rounds)
        if self.iterations > self.demonstrations.per_learner:
            raise ExperimentError(
                f"iterations {self.iterations}: expected at most demonstrations.per_learner,"
                f" {self.demonstrations.per_learner}; record more, or learn fewer"
            )
        self._check_choices()
        self._check_rollouts()
        if isinstance(self.algorithm.policy, LatticeSettings):
            self._check_lattice(self.algorithm.policy)
        return self

    def _check_choices(self) -> None:
        """Finders, expectations and experts must be made for the game."""
        for name, fitting in CHOICES[self.game.kind].items():
            given = attrgetter(name)(self)
            if given not in fitting:
                raise ExperimentError(f"{name} {given!r}: the game is {self.game.kind}; take one of {list(fitting)}")

    def _check_lattice(self, lattice: LatticeSettings) -> None:
        """One or two drones, and values that fit into memory."""
        game = self.game
        if not isinstance(game, DroneSettings):
            return
        if game.n_experts > 2 or game.dynamics != "single_integrator":
            raise ExperimentError(
                f"algorithm.policy lattice: made for one or two single integrators, found {game.n_experts} drones that"
                f" are {game.dynamics}s; take soft_actor_critic"
            )
        nodes = math.prod(float(count) for count in game.lattice(lattice.spacing))
        of_states = nodes**game.n_experts * (game.horizon + 2)
        of_moves = nodes * game.n_experts * MOVES * math.prod(map(float, game.window(lattice.spacing)))
        if (values := max(of_states, of_moves)) > MOST_VALUES:
            raise ExperimentError(
                f"algorithm.policy.spacing {lattice.spacing:g} m makes {values:.2g} values, expected at most"
                f" {MOST_VALUES:.2g}; take a larger one"
            )

    def _check_rollouts(self) -> None:
        """What is rolled out at once must fit into memory."""
        counts, most = {"rollouts": self.algorithm.rollouts}, MOST_STEPS // (self.game.horizon + 1)
        if isinstance(self.algorithm.policy, SoftQSettings):
            counts["policy.episodes"] = self.algorithm.policy.episodes
        if isinstance(self.algorithm.policy, SoftActorCriticSettings):
            counts["policy.rollouts"] = self.algorithm.policy.rollouts
        for name, count in counts.items():
            if count > most:
                raise ExperimentError(
                    f"algorithm.{name} {count}: expected at most {most} for horizon {self.game.horizon}; take fewer"
                )

    @property
    def edge_schedule(self) -> EdgeSchedule:
        """E(n) for the learners of this experiment."""
        return self.schedule.build(self.learners)

    def index_of(self, learner: str) -> int:
        """Place of a learner in the list; raises ExperimentError where it is none of them."""
        if learner not in self.learners:
            raise ExperimentError(f"{learner!r} is none of the learners {list(self.learners)}")
        return self.learners.index(learner)

    @property
    def digest(self) -> str:
        """SHA-256 of what decides theta and omega and when to end. Not of the schedule, nor of the bag's place."""
        deciding = {"game", "algorithm", "learners", "mixing", "baselines", "iterations", "closing_rounds", "seed"}
        content = self.model_dump(mode="json", include=deciding)
        return digest(content)

    def run_digest(self, run: str) -> str:
        """Digest of one run of the experiment: two networks in one ROS domain are told apart by ``run``."""
        return digest([self.digest, run]) if run else self.digest


def load_experiment(path: Path) -> Experiment:
    """Read and check an experiment file; raises ExperimentError naming the file and every wrong setting."""
    try:
        content = read_yaml(path)
    except OSError as error:
        raise ExperimentError(
            f"{path}: cannot be read ({error.strerror}); give the path of an experiment file"
        ) from None
    except ValueError as error:
        raise ExperimentError(f"{path}: is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise ExperimentError(f"{path}: expected the settings of an experiment, found {type(content).__name__}")
    return _checked(path, content)


def _checked(path: Path, content: dict[str, Any]) -> Experiment:
    try:
        # As JSON, so that strict types still let a list be a tuple: true is no number here, and "12" neither.
        text = _json(content)
    except (ValueError, TypeError, RecursionError) as error:
        raise ExperimentError(f"{path}: {error}") from None
    try:
        experiment = Experiment.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise ExperimentError(f"{path}: {shortened('; '.join(_explanations(error)), LONGEST_ERROR)}") from None
    except MabirdsError as error:
        raise ExperimentError(f"{path}: {shortened(str(error), LONGEST_ERROR)}") from None
    try:
        bag = (path.parent / experiment.demonstrations.bag).resolve()
    except ValueError as error:  # a character that no path may have
        raise ExperimentError(f"{path}: demonstrations.bag: {error}") from None
    demonstrations = experiment.demonstrations.model_copy(update={"bag": bag})
    return experiment.model_copy(update={"demonstrations": demonstrations})


def _json(content: dict[str, Any]) -> str:
    """As JSON, piece by piece: a few aliases of aliases can stand for gigabytes."""
    pieces, size = list[str](), 0
    for piece in json.JSONEncoder(default=str).iterencode(content):
        pieces.append(piece)
        size += len(piece)
        if size > MOST_CHARACTERS:
            raise ValueError(f"its settings, with aliases written out, have more than {MOST_CHARACTERS} characters")
    return "".join(pieces)


def _explanations(error: ValidationError) -> Iterator[str]:
    for problem in error.errors():
        place = printable(".".join(_setting(problem["loc"]))) or "experiment"
        given = shortened(repr(problem["input"]), LONGEST_VALUE)
        explanation = shortened(problem["msg"].removeprefix("Value error, "), LONGEST_EXPLANATION)
        yield f"{place}: {explanation}" + ("" if isinstance(problem["input"], dict) else f" (given: {given})")


def _setting(location: tuple[int | str, ...]) -> Iterator[str]:
    """Levels of the file down to a setting; the kind of the game, which pydantic names after it, is none."""
    levels = location[:1] + location[2:] if location[0:1] == ("game",) else location
    return map(str, levels)
