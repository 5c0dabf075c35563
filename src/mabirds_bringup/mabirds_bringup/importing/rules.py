"""The rules of an import as written in a YAML file; metres, seconds, in the frame of the recording."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from mabirds_core.errors import ExperimentError
from mabirds_core.settings import Settings
from mabirds_core.yaml_files import read_yaml

Point = tuple[float, float]
Seconds = Annotated[float, Field(gt=0, le=86_400)]
Metres = Annotated[float, Field(gt=0, le=10_000)]

HEADINGS: dict[str, Point] = {"east": (1, 0), "west": (-1, 0), "north": (0, 1), "south": (0, -1)}
"""Directions by name: x grows to the east, y to the north."""


class Region(Settings):
    """A disc."""

    centre: Point = Field(description="x, y [m]")
    radius: Metres = Field(description="[m]")


class GoalRule(Region):
    """A disc, or a door."""

    until: Point | None = Field(None, description="of a door, whose segment from `centre` to here is the way out")


class ExpertRule(Settings):
    """Who is an expert, and where it goes."""

    agent: str | None = Field(None, description="topic, child frame or id in the recording")
    heads: Literal["east", "west", "north", "south"] | None = Field(
        None, description="any agent whose way from first to last place goes there most of all, instead of `agent`"
    )
    goal: GoalRule = Field(description="where it wants to be")
    enter: Region | None = Field(None, description="where it waits before an episode, for episodes by regions")

    @model_validator(mode="after")
    def _is_told_one_way(self) -> "ExpertRule":
        if (self.agent is None) == (self.heads is None):
            raise ValueError("expected either `agent` or `heads`; write one of them")
        return self


class AreaRule(Settings):
    """What part of the plane belongs to the game."""

    corners: tuple[Point, Point] | None = Field(None, description="lower left and upper right")
    map: Path | None = Field(None, description="a map_server YAML instead, relative to the rules")

    @model_validator(mode="after")
    def _is_told_one_way(self) -> "AreaRule":
        if (self.corners is None) == (self.map is None):
            raise ValueError("expected either `corners` or `map`; write one of them")
        if self.corners and not all(low < high for low, high in zip(*self.corners, strict=True)):
            raise ValueError(f"corners {self.corners}: expected the lower left one, then the upper right one")
        return self


class EpisodeRule(Settings):
    """How a recording is cut into demonstrations."""

    by: Literal["regions", "pauses", "length", "together"] = Field(
        description="from `enter` regions to goals; between pauses; pieces of one length; while agents are in view"
    )
    pause_speed: Metres = Field(0.05, description="slower than this is a pause [m/s]")
    pause: Seconds = Field(2.0, description="the shortest pause")
    length: Seconds = Field(10.0, description="of pieces of one length")
    shortest: Seconds = Field(1.0, description="shorter episodes are dropped")
    reuse: bool = Field(False, description="together: may an agent be in several episodes?")


class LearnerRule(Settings):
    """Which learner sees which demonstration."""

    count: int = Field(4, ge=1, le=1000)
    by: Literal["round_robin", "file", "host"] = Field(
        "round_robin", description="in turn; by the recording; by the name of its folder, as each host has one"
    )
    passes: int = Field(1, ge=1, le=10_000, description="how often each learner sees its demonstrations")


class LimitRule(Settings):
    """What is doubtful or impossible."""

    gap: Seconds = Field(1.0, description="longer silence cuts an agent's track; shorter one is interpolated")
    speed: Metres = Field(5.0, description="faster is a jump [m/s]")
    clock_offset: Seconds = Field(0.2, description="of two agents' clocks against the recorder's")
    residual: Metres | None = Field(
        None, description="between recorded places and the demonstration; default: half of the way of a step"
    )


class StepRule(Settings):
    """How time is divided."""

    time_step: Annotated[float, Field(gt=0, le=60)] = Field(0.25, description="of the game [s]")
    horizon: int | None = Field(
        None, ge=1, le=10_000, description="T; default: a quarter more than the longest episode needs"
    )
    max_speed: Metres | None = Field(None, description="default: the fastest step of the episodes [m/s]")


class ImportRules(Settings):
    """What `mabirds import` is told."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", description="of the experiment")
    experts: tuple[ExpertRule, ...] = Field(min_length=1, max_length=10)
    area: AreaRule
    clock: Literal["header", "received"] = Field(
        "header", description="time of a sample: its stamp, or when it was received"
    )
    frames_per_second: float = Field(1.0, gt=0, le=1e9, description="of the column `frame` of CSV files")
    episodes: EpisodeRule
    steps: StepRule = StepRule()
    learners: LearnerRule = LearnerRule()
    limits: LimitRule = LimitRule()
    held_out: float = Field(0.0, ge=0, lt=1, description="share of the time, at its end, that nobody learns from")
    game: dict[str, Any] = Field(description="its kind, and settings in the place of what is taken from recordings")
    experiment: dict[str, Any] = Field({}, description="further settings of the experiment, such as `algorithm`")

    @model_validator(mode="after")
    def _fits_together(self) -> "ImportRules":
        if "kind" not in self.game:
            raise ValueError("game: expected at least its `kind`; `mabirds kinds` lists them")
        by_role = [expert.agent is None for expert in self.experts]
        if any(by_role) != all(by_role):
            raise ValueError("experts: expected `agent` for all, or `heads` for all")
        if any(by_role) != (self.episodes.by == "together"):
            raise ValueError("episodes.by: agents with `heads` have episodes by `together`, and only they")
        if self.episodes.by == "regions" and not all(expert.enter for expert in self.experts):
            raise ValueError("experts: episodes by regions need `enter` for each")
        return self


def load_rules(path: Path) -> ImportRules:
    """Read and check rules.

    Parameters
    ----------
    path : Path
        Of the YAML file.

    Returns
    -------
    ImportRules
        Checked; the place of a map is absolute.

    Raises
    ------
    ExperimentError
        That names every wrong setting.
    """
    try:
        rules = ImportRules.model_validate(read_yaml(path))
    except OSError as error:
        raise ExperimentError(f"{path}: cannot be read ({error.strerror}); give a file of rules") from None
    except ValidationError as error:
        problems = (f"{'.'.join(map(str, one['loc'])) or 'rules'}: {one['msg']}" for one in error.errors())
        raise ExperimentError(f"{path}: {'; '.join(problems)}") from None
    except ValueError as error:
        raise ExperimentError(f"{path}: is not YAML: {error}") from None
    if rules.area.map is None:
        return rules
    return rules.model_copy(update={"area": rules.area.model_copy(update={"map": path.parent / rules.area.map})})
