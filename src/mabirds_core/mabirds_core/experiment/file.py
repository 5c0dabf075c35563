"""An experiment file: the one typed, validated source of truth for game, algorithm, learners, schedule and bag."""

import json
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from pydantic import Field, ValidationError, model_validator

from mabirds_core.consensus.assumptions import validate
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.schedule_settings import LearnerName
from mabirds_core.consensus.strict import StrictMixing
from mabirds_core.digest import experiment_digest
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.learning_settings import AlgorithmSettings, BaselineSettings
from mabirds_core.kind_settings import settings_of
from mabirds_core.planners.settings import check_rollouts
from mabirds_core.registry import GROUPS, build, kind_of, kinds
from mabirds_core.settings import Settings, renamed_settings
from mabirds_core.texts import sanitize, truncate
from mabirds_core.yaml_files import MAX_FILE, read_yaml

KINDS_REMEDY = "; `mabirds kinds` lists what is installed, and what cannot be used and why"
"""Where a file names a kind that there is not."""

GAMES, PLANNERS, COSTS = "mabirds.games", "mabirds.planners", "mabirds.costs"

MAX_VALUE = 60
"""Characters of a wrong value that an error shows."""

MAX_CHARACTERS = 4 * MAX_FILE
"""Characters of an experiment's settings as JSON, at most."""

MAX_EXPLANATION = 500
"""Characters that say what is wrong with one setting."""

MAX_ERROR = 4000
"""Characters of an error, however many settings are wrong."""

RESERVED_NAMES = {"expert_player", "demonstration"}
"""The player's name, and what a status says when a demonstration is missing."""


if TYPE_CHECKING:
    GameSettings: TypeAlias = Any
    ScheduleSettings: TypeAlias = Any
    MixingSettings: TypeAlias = Any
else:
    GameSettings = settings_of("mabirds.games")
    ScheduleSettings = settings_of("mabirds.schedules")
    MixingSettings = settings_of("mabirds.mixers")

PassingSide = Literal["by_start", "random", "left", "right"]
"""The side of an obstacle on which experts pass: where they started from it, either, or the same for all."""


class DemonstrationSettings(Settings):
    """Where the recorded demonstrations are, and how they are recorded."""

    bag: Path = Field(description="rosbag2 directory, relative to the experiment file")
    per_learner: int = Field(40, ge=1, le=1_000_000, description="demonstrations per learner")
    period: float = Field(1.0, gt=0, le=86_400, description="seconds between two demonstrations in the recording")
    experts: str = Field("optimal", description="of the game: least cost, maximum entropy, ...")
    side: PassingSide = Field("by_start", description="on which side experts pass obstacles, or what decides")
    seed: int = Field(0, ge=0, description="of the experts' choices")


class Experiment(Settings):
    """One experiment; see ros_ws/config for commented examples."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")
    game: GameSettings
    algorithm: AlgorithmSettings = AlgorithmSettings()
    learners: tuple[LearnerName, ...] = Field(min_length=1, max_length=1000)
    schedule: ScheduleSettings
    mixing: MixingSettings = Field(StrictMixing(), description="strict, or resilient to loss")
    demonstrations: DemonstrationSettings
    baselines: BaselineSettings = BaselineSettings()
    iterations: int = Field(ge=1, le=1_000_000, description="updates per learner, one demonstration each")
    closing_rounds: int = Field(0, ge=0, le=10_000, description="rounds of averaging alone, after the last update")
    seed: int = Field(0, ge=0, description="of the learners' rollouts")
    constraint_confidence: float = Field(0.5, gt=0, lt=1, description="at which a feature is called a constraint")
    constraint_threshold: float = Field(
        0.005, ge=0, description="the paper's rule, for games without a test: a constraint where -omega exceeds this"
    )

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
        return self

    def _check_choices(self) -> None:
        """Planners, expectations and experts must be made for the game, and what is rolled out must fit into memory."""
        game, planner = build(GAMES, self.game), kind_of(PLANNERS, self.algorithm.policy)
        costs = kind_of(COSTS, self.algorithm.cost)
        form = kind_of(GAMES, self.game).form
        fits = planner.form in {None, form}  # then the names of others need not be known, nor these be loaded
        fitting = {
            "algorithm.policy.kind": (self.algorithm.policy.kind,) if fits else planners_for(form),
            "algorithm.expectation": game.expectations,
            "demonstrations.experts": game.expert_kinds or (self.demonstrations.experts,),
        }
        for name, choices in fitting.items():
            given = attrgetter(name)(self)
            if given is not None and given not in choices:
                raise ExperimentError(f"{name} {given!r}: the game is {self.game.kind}; take one of {list(choices)}")
        check_rollouts("rollouts", self.algorithm.rollouts, game.horizon)
        for kind, settings in ((planner, self.algorithm.policy), (costs, self.algorithm.cost)):
            if kind.check:
                kind.check(settings, game)

    @property
    def edge_schedule(self) -> EdgeSchedule:
        """E(n) for the learners of this experiment."""
        schedule: EdgeSchedule = build("mabirds.schedules", self.schedule, self.learners)
        return schedule

    def index_of(self, learner: str) -> int:
        """Place of a learner in the list.

        Raises
        ------
        ExperimentError
            It is none of them.
        """
        if learner not in self.learners:
            raise ExperimentError(f"{learner!r} is none of the learners {list(self.learners)}")
        return self.learners.index(learner)

    @property
    def digest(self) -> str:
        """Digest of what decides theta and omega and when to end. Not of the schedule, nor of the bag's place.

        Of the settings that are not at their defaults: options that come to be later change no digest. It names the
        arithmetic.
        """
        return experiment_digest(self._deciding)

    @property
    def _deciding(self) -> dict[str, Any]:
        deciding = ("game", "algorithm", "learners", "mixing", "iterations", "closing_rounds", "seed")
        content = without_defaults(self)
        return {name: content[name] for name in deciding if name in content}

    def run_digest(self, run: str) -> str:
        """Digest of one run of the experiment: two networks in one ROS domain are told apart by ``run``."""
        return experiment_digest([self._deciding, run]) if run else self.digest


def planners_for(form: str | None) -> tuple[str, ...]:
    """Names of the planners that are made for games of a form."""
    return tuple(name for name, kind in kinds(PLANNERS).items() if kind.form in {None, form})


def without_defaults(settings: Settings) -> dict[str, Any]:
    """What a file must say to mean ``settings``, as JSON: the values that differ from their defaults, and all kinds."""
    parts = {name for name, value in settings if isinstance(value, Settings)}  # written below, by themselves
    content = settings.model_dump(mode="json", exclude=parts)
    return {
        name: without_defaults(value) if name in parts else _written(value, content[name])
        for name, value in settings
        if (name in parts or name in content) and (name == "kind" or value != _default(settings, name))
    }


def _written(value: Any, as_json: Any) -> Any:
    """A value in the same form, also settings in lists and by name: an option of theirs may come to be later, too."""
    if isinstance(value, Settings):
        return without_defaults(value)
    if isinstance(value, dict):
        return {name: _written(part, as_json[name]) for name, part in value.items()}
    if isinstance(value, tuple):
        return [_written(*pair) for pair in zip(value, as_json, strict=True)]
    return as_json


def _default(settings: Settings, name: str) -> Any:
    return type(settings).model_fields[name].get_default(call_default_factory=True, validated_data={})


def load_experiment(path: Path) -> Experiment:
    """Read and check an experiment file.

    Raises
    ------
    ExperimentError
        The message names the file and every wrong setting.
    """
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
    return checked(content, str(path), path.parent)


def checked(content: dict[str, Any], source: str, directory: Path) -> Experiment:
    """The experiment of the settings.

    Parameters
    ----------
    content : dict
        As in a file.
    source : str
        What errors begin with, such as the file's path.
    directory : Path
        That the bag's place is relative to.

    Returns
    -------
    Experiment
        Checked.

    Raises
    ------
    ExperimentError
        That names every wrong setting.
    """
    try:
        # As JSON, so that strict types still let a list be a tuple: true is no number here, and "12" neither.
        text = _json(content)
    except (ValueError, TypeError, RecursionError) as error:
        raise ExperimentError(f"{source}: {error}") from None
    try:
        experiment = Experiment.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise ExperimentError(f"{source}: {truncate('; '.join(_explanations(error)), MAX_ERROR)}") from None
    except MabirdsError as error:
        raise ExperimentError(f"{source}: {truncate(str(error), MAX_ERROR)}") from None
    try:
        bag = (directory / experiment.demonstrations.bag).resolve()
    except ValueError as error:  # a character that no path may have
        raise ExperimentError(f"{source}: demonstrations.bag: {error}") from None
    demonstrations = experiment.demonstrations.model_copy(update={"bag": bag})
    return experiment.model_copy(update={"demonstrations": demonstrations})


def _json(content: dict[str, Any]) -> str:
    """``content`` as JSON, piece by piece: a few aliases of aliases can stand for gigabytes."""
    pieces, size = list[str](), 0
    for piece in json.JSONEncoder(default=str).iterencode(content):
        pieces.append(piece)
        size += len(piece)
        if size > MAX_CHARACTERS:
            raise ValueError(f"its settings, with aliases written out, have more than {MAX_CHARACTERS} characters")
    return "".join(pieces)


def _explanations(error: ValidationError) -> Iterator[str]:
    for group in GROUPS:
        kinds(group)  # are loaded, so that it is known what is called otherwise now
    renamed = renamed_settings()
    for problem in error.errors():
        place = sanitize(".".join(_setting(problem["loc"]))) or "experiment"
        given = truncate(repr(problem["input"]), MAX_VALUE)
        explanation = truncate(problem["msg"].removeprefix("Value error, "), MAX_EXPLANATION)
        if problem["type"] == "union_tag_invalid":
            explanation += KINDS_REMEDY
        if problem["type"] == "extra_forbidden" and problem["loc"][-1] in renamed:
            explanation = f"now {renamed[problem['loc'][-1]]}; rename it"
        yield f"{place}: {explanation}" + ("" if isinstance(problem["input"], dict) else f" (given: {given})")


def _setting(location: tuple[int | str, ...]) -> Iterator[str]:
    """Levels of the file down to a setting; the kind of the game, which pydantic names after it, is none."""
    levels = location[:1] + location[2:] if location[0:1] == ("game",) else location
    return map(str, levels)
