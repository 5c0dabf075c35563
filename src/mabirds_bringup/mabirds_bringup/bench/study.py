"""A study: a file that declares which experiments are learned how, and what its report shows and is to show."""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import method_names
from mabirds_core.experiment.file import Experiment, checked, load_experiment
from mabirds_core.settings import Settings
from mabirds_core.yaml_files import read_yaml

PACKAGED = Path(__file__).parents[1] / "studies"
"""Where the studies of the package are."""

Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$")]
"""Of an experiment or a group; files of pictures are called by it."""

MABIRDS = "MA-BIRDS"
"""The label of the network of learners."""


@dataclass(frozen=True)
class Case:
    """One way to learn one experiment.

    Attributes
    ----------
    group, label : str
        Its place in the results.
    experiment : Experiment
        What is learned.
    method : str or None
        A central method; None: the network of learners.
    own_policies : bool
        Are the policies that the learner itself planned judged, too?
    rollouts : int or None
        How many judge the last policies, where the judge takes some; a tenth of them judge the others.
    optimum : bool
        Is it compared with the pooled optimum, and are decidable constraints told?
    judged_every : int
        Every how many iterations the policy is judged, beside the last update and the end.
    """

    group: str
    label: str
    experiment: Experiment
    method: str | None = None
    own_policies: bool = False
    rollouts: int | None = None
    optimum: bool = False
    judged_every: int = 1

    def seeded(self, seed: int) -> Experiment:
        """The experiment with demonstrations and rollouts of their own."""
        demonstrations = self.experiment.demonstrations.model_copy(update={"seed": seed})
        return self.experiment.model_copy(update={"seed": seed, "demonstrations": demonstrations})


class CaseSettings(Settings):
    """One line of a group."""

    label: str = Field(MABIRDS, min_length=1, description="in tables and pictures")
    experiment: str = Field("main", description="one of the study's")
    method: str | None = Field(None, description="a central method; none: the network of learners")
    changes: dict[str, Any] = Field(
        {}, description="settings in place of the experiment's; a mapping with a kind is whole"
    )
    optimum: bool = Field(False, description="compare with the pooled optimum; of games that can be enumerated")


class GroupSettings(Settings):
    """Cases that are compared with each other."""

    title: str
    cases: tuple[CaseSettings, ...] = Field(min_length=1)
    own_policies: bool = Field(False, description="judge the policies that learners planned themselves, too")
    pictures: tuple[Literal["learned", "thresholds", "rates", "likelihood", "consensus", "effort"], ...] = ("rates",)
    shown: tuple[str, ...] | None = Field(None, description="labels whose learned policies are pictured; none: all")


class TargetSettings(Settings):
    """What a measure is to be, by label."""

    measure: str
    groups: tuple[str, ...]
    at_most: dict[str, float] = Field({}, description="limits by label")
    at_least: dict[str, float] = Field({}, description="limits by label")


class TableSettings(Settings):
    """Measures of a game, a line for each thing that they measure, over the learners of a case and seeds."""

    title: str
    group: str
    label: str = MABIRDS
    columns: dict[str, str] = Field(description="title: measure")


class Study(Settings):
    """A study file; ``mabirds_bringup/studies`` has some."""

    title: str = Field(description="may name settings of the experiments, such as {main.iterations}")
    note: str = Field(description="how to read the report; may name {rollouts} and {fewer}")
    experiments: dict[Name, Path] = Field(min_length=1, description="files by name, relative to the study's")
    groups: dict[Name, GroupSettings] = Field(min_length=1)
    columns: dict[str, str] = Field(description="title: measure, a mean and range over seeds")
    tables: tuple[TableSettings, ...] = ()
    targets: tuple[TargetSettings, ...] = ()
    rollouts: int | None = Field(
        None, ge=20, le=100_000, description="that judge the last policies, a tenth the others"
    )
    judged_every: int = Field(
        1, ge=1, le=1000, description="iterations from one judged policy to the next; the last ones are judged anyway"
    )

    @model_validator(mode="after")
    def _names_fit(self) -> "Study":
        cases = [(name, case) for name, group in self.groups.items() for case in group.cases]
        if len({(name, case.label) for name, case in cases}) < len(cases):
            raise ExperimentError("two cases of a group have one label; give each its own")
        groups = {name for target in self.targets for name in target.groups} | {table.group for table in self.tables}
        _require("experiment", {case.experiment for _, case in cases}, self.experiments)
        _require("method", {case.method for _, case in cases if case.method}, method_names())
        _require("group", groups, self.groups)
        return self


def _require(what: str, names: Iterable[str], there: Collection[str]) -> None:
    for name in sorted(set(names) - set(there)):
        raise ExperimentError(f"{what} {name!r}: expected one of {sorted(there)}")


@dataclass(frozen=True)
class LoadedStudy:
    """A study with its experiments; ``title`` and ``note`` name settings of theirs."""

    settings: Study
    file: Path
    experiments: Mapping[str, Experiment]
    title: str
    note: str

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """All cases, in order."""
        return tuple(self._cases())

    def _cases(self) -> Iterator[Case]:
        for name, group in self.settings.groups.items():
            for case in group.cases:
                content = merged(self.experiments[case.experiment].model_dump(mode="json"), case.changes)
                experiment = checked(content, f"{self.file}: {name}, {case.label}", self.file.parent)
                yield Case(
                    *(name, case.label, experiment, case.method, group.own_policies),
                    *(self.settings.rollouts, case.optimum, self.settings.judged_every),
                )


def packaged_studies() -> tuple[str, ...]:
    """Names of the studies of the package."""
    return tuple(sorted(path.stem for path in PACKAGED.glob("*.yaml")))


def load_study(
    name: str, files: Mapping[str, Path] | None = None, iterations: int | None = None, rollouts: int | None = None
) -> LoadedStudy:
    """Read and check a study and its experiments.

    Parameters
    ----------
    name : str
        Of a study of the package, or the path of a file.
    files : Mapping
        Experiment files in place of the study's, by the names that it gives them.
    iterations : int or None
        Of each experiment, at most.
    rollouts : int or None
        In place of the study's.

    Returns
    -------
    LoadedStudy
        The study.

    Raises
    ------
    ExperimentError
        Where there is no such study, or something in it is wrong.
    """
    path = PACKAGED / f"{name}.yaml" if name in packaged_studies() else Path(name)
    settings = _read(path)
    _require(f"{path}: experiment", files or {}, settings.experiments)
    places = {key: path.parent / file for key, file in settings.experiments.items()} | dict(files or {})
    if rollouts is not None:
        settings = settings.model_copy(update={"rollouts": rollouts})
    experiments = {key: _truncated(load_experiment(place), iterations) for key, place in places.items()}
    counts = {"rollouts": settings.rollouts, "fewer": (settings.rollouts or 0) // 10}
    try:
        title, note = (text.format(**experiments, **counts) for text in (settings.title, settings.note))
    except (LookupError, AttributeError, ValueError) as error:
        raise ExperimentError(f"{path}: title and note may name {{main.iterations}} and such: {error!r}") from None
    return LoadedStudy(settings, path, experiments, title, note)


def _read(path: Path) -> Study:
    try:
        content = json.dumps(read_yaml(path), default=str)
        return Study.model_validate_json(content, strict=True)  # as experiments: true is no number, nor is "12"
    except OSError as error:
        choice = ", ".join(packaged_studies())
        raise ExperimentError(f"{path}: {error.strerror}; give a study's file, or one of {choice}") from None
    except ValidationError as error:
        raise ExperimentError(f"{path}: {'; '.join(map(_explanation, error.errors()))}") from None
    except ValueError as error:
        raise ExperimentError(f"{path}: is not YAML: {error}") from None


def _explanation(problem: Mapping[str, Any]) -> str:
    place = ".".join(map(str, problem["loc"])) or "study"
    return f"{place}: {problem['msg'].removeprefix('Value error, ')}"


def _truncated(experiment: Experiment, iterations: int | None) -> Experiment:
    return experiment.model_copy(update={"iterations": min(iterations or experiment.iterations, experiment.iterations)})


def merged(content: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``content`` with what ``changes`` says, level by level; a mapping with a kind takes the old one's place.

    >>> merged({"a": {"x": 1, "y": 2}, "b": {"kind": "u", "z": 3}}, {"a": {"x": 5}, "b": {"kind": "v"}})
    {'a': {'x': 5, 'y': 2}, 'b': {'kind': 'v'}}
    """
    return {**content, **{name: _merged(content.get(name), value) for name, value in changes.items()}}


def _merged(before: Any, value: Any) -> Any:
    both = isinstance(before, dict) and isinstance(value, dict) and "kind" not in value
    return merged(before, value) if both else value
