"""An experiment file: the one typed, validated source of truth for game, algorithm, learners, schedule and bag."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, model_validator

from mabirds_core.digest import digest
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.games.patrol import PatrolSettings
from mabirds_core.generators import (
    alternating_ring,
    complete_edges,
    directed_ring,
    gossip,
    random_matching,
    ring_edges,
    static,
)
from mabirds_core.gradient import RolloutStart
from mabirds_core.mixing import MixingSettings, StrictMixing
from mabirds_core.parameters import StepSizes
from mabirds_core.schedule import EdgeSchedule, End, both_ways, validate
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

RESERVED_NAMES = {"expert_player", "demonstration"}
"""The player's name, and what a status says when a demonstration is missing."""

LearnerName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]


class LinearRewardSettings(Settings):
    """r_theta = theta^T f."""

    kind: Literal["linear"] = "linear"


class NeuralRewardSettings(Settings):
    """r_theta of a small network, |r_theta| <= bound."""

    kind: Literal["neural"]
    hidden: int = Field(32, ge=1, le=10_000, description="units of the hidden layer")
    bound: float = Field(10.0, gt=0, le=1000, description="C: no reward is larger in absolute value")


class SoftValueIterationSettings(Settings):
    """The exact policy, by enumerating the game."""

    kind: Literal["soft_value_iteration"] = "soft_value_iteration"


class SoftQSettings(Settings):
    """A policy learned from episodes, starting from that of the iteration before."""

    kind: Literal["soft_q_learning"]
    episodes: int = Field(200, ge=1, le=1_000_000, description="episodes a sweep")
    sweeps: int = Field(4, ge=1, le=1000, description="sweeps an iteration, each with the newest policy")
    exploration: float = Field(0.2, ge=0, le=1, description="share of actions drawn uniformly")


class AlgorithmSettings(Settings):
    """Algorithm 1's settings."""

    steps: StepSizes
    window: int = Field(1, ge=1, le=1000, description="l: demonstrations in a gradient")
    expectation: Literal["sampled", "exact"] = Field("sampled", description="rollouts, or the occupancy measure")
    rollouts: int = Field(100, ge=1, le=1_000_000, description="m: trajectories a gradient, where sampled")
    rollout_start: RolloutStart = Field("initial", description="roll out from P_0, or where demonstrations began")
    reward: LinearRewardSettings | NeuralRewardSettings = Field(
        LinearRewardSettings(), discriminator="kind", description="the reward model"
    )
    policy: SoftValueIterationSettings | SoftQSettings = Field(
        SoftValueIterationSettings(), discriminator="kind", description="how the policy is found"
    )


class FtlSettings(Settings):
    """Follow the leader."""

    steps: StepSizes | None = Field(None, description="step sizes; default: the algorithm's")
    tolerance: float = Field(0.3, gt=0, description="largest entry of a gradient that counts as stationary")
    most_steps: int = Field(50, ge=1, le=100_000, description="gradient steps an iteration")


class DlmSettings(Settings):
    """The double loop."""

    steps: StepSizes | None = Field(None, description="step sizes; default: the algorithm's")
    tolerance: float = Field(0.5, gt=0, description="largest entry of the inner gradient that counts as solved")
    most_steps: int = Field(50, ge=1, le=100_000, description="inner steps an iteration")
    window: int = Field(10, ge=1, le=1000, description="l: iterations whose demonstrations make a loss")


class MeGreedySettings(Settings):
    """Maximum-likelihood constraint inference with the true reward given."""

    least_mass: float = Field(0.01, gt=0, lt=1, description="probability that a new constraint must remove")


class BaselineSettings(Settings):
    """The central methods that the experiment is compared with. BICS takes the settings of the algorithm."""

    ftl: FtlSettings = FtlSettings()
    dlm: DlmSettings = DlmSettings()
    me_greedy: MeGreedySettings = MeGreedySettings()


class StaticSchedule(Settings):
    """The same undirected edges at every iteration."""

    kind: Literal["static"]
    graph: Literal["complete", "ring"] = "complete"

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        edges = {"complete": complete_edges, "ring": ring_edges}[self.graph]
        return static(learners, edges(len(learners)))


class AlternatingSchedule(Settings):
    """Every other edge of the ring of learners, in turns."""

    kind: Literal["alternating"]

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        return alternating_ring(learners)


class DirectedRingSchedule(Settings):
    """Each learner sends to the next, the last to the first."""

    kind: Literal["directed_ring"]

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        return directed_ring(learners)


class RandomSchedule(Settings):
    """Random pairs: a matching of all learners in every slot, or a single pair (gossip)."""

    kind: Literal["random_matching", "gossip"]
    slots: int = Field(ge=1, le=100_000, description="drawn once, then repeated")
    seed: int = Field(0, ge=0)

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners; raises ScheduleError where the slots are too few to connect them."""
        generator = {"random_matching": random_matching, "gossip": gossip}[self.kind]
        return generator(learners, self.slots, self.seed)


class ExplicitSchedule(Settings):
    """Slots written out: lists of [sender, receiver] names."""

    kind: Literal["slots"]
    slots: tuple[tuple[tuple[LearnerName, LearnerName], ...], ...] = Field(min_length=1)
    undirected: bool = Field(False, description="open every edge both ways")
    end: End = Field("repeat", description="after the last slot: repeat them, hold the last one, or stop")

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners; raises ExperimentError for a name that is none of them."""
        index = {name: number for number, name in enumerate(learners)}
        for name in (name for slot in self.slots for edge in slot for name in edge):
            if name not in index:
                raise ExperimentError(f"schedule: {name!r} is none of the learners {list(learners)}")
        slots = [[(index[sender], index[receiver]) for sender, receiver in slot] for slot in self.slots]
        opened = tuple(both_ways(slot) if self.undirected else frozenset(slot) for slot in slots)
        return EdgeSchedule(learners, opened, self.end)


ScheduleSettings = Annotated[
    StaticSchedule | AlternatingSchedule | DirectedRingSchedule | RandomSchedule | ExplicitSchedule,
    Field(discriminator="kind"),
]


class DemonstrationSettings(Settings):
    """Where the recorded demonstrations are, and how they are recorded."""

    bag: Path = Field(description="rosbag2 directory, relative to the experiment file")
    per_learner: int = Field(40, ge=1, le=1_000_000, description="demonstrations a learner")
    period: float = Field(1.0, gt=0, le=86_400, description="seconds between two demonstrations in the recording")
    experts: Literal["optimal", "soft"] = Field("optimal", description="least cost, or maximum entropy")
    seed: int = Field(0, ge=0, description="of the experts' choices")


class Experiment(Settings):
    """One experiment; see ros_ws/config for commented examples."""

    name: str = Field(pattern=r"^[a-z0-9][a-z0-9_-]*$")
    game: PatrolSettings
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
        self._check_rollouts()
        return self

    def _check_rollouts(self) -> None:
        """What is rolled out at once must fit into memory."""
        counts, most = {"rollouts": self.algorithm.rollouts}, MOST_STEPS // (self.game.horizon + 1)
        if isinstance(self.algorithm.policy, SoftQSettings):
            counts["policy.episodes"] = self.algorithm.policy.episodes
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
        place = printable(".".join(str(part) for part in problem["loc"])) or "experiment"
        given = shortened(repr(problem["input"]), LONGEST_VALUE)
        explanation = shortened(problem["msg"].removeprefix("Value error, "), LONGEST_EXPLANATION)
        yield f"{place}: {explanation}" + ("" if isinstance(problem["input"], dict) else f" (given: {given})")
