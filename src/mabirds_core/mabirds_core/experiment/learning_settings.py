"""How an experiment learns, as written in its file: reward model, policy finder, Algorithm 1, central methods."""

from typing import Literal

from pydantic import Field

from mabirds_core.algorithm.gradient import RolloutStart
from mabirds_core.algorithm.parameters import StepSizes
from mabirds_core.settings import Settings


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
    episodes: int = Field(200, ge=1, le=1_000_000, description="episodes per sweep")
    sweeps: int = Field(4, ge=1, le=1000, description="sweeps per iteration, each with the newest policy")
    exploration: float = Field(0.2, ge=0, le=1, description="share of actions drawn uniformly")


class LatticeSettings(Settings):
    """Near-exact: soft value iteration on a lattice, for one or two drones that are single integrators."""

    kind: Literal["lattice"]
    spacing: float = Field(0.3, ge=1e-6, le=1000, description="largest distance of two nodes [m]")
    temperature: float = Field(1.0, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")


class SoftActorCriticSettings(Settings):
    """Networks that learn from imagined flights and observed demonstrations, kept from iteration to iteration."""

    kind: Literal["soft_actor_critic"]
    temperature: float = Field(0.02, gt=0, le=1000, description="tau: the policy is that of the reward divided by it")
    hidden: int = Field(128, ge=1, le=10_000, description="units of each of the two hidden layers")
    steps: int = Field(150, ge=1, le=1_000_000, description="gradient steps per search")
    first_steps: int = Field(600, ge=1, le=1_000_000, description="gradient steps of the first search")
    batch: int = Field(128, ge=1, le=1_000_000, description="transitions per gradient step")
    capacity: int = Field(30_000, ge=1, le=10_000_000, description="transitions that are kept")
    rollouts: int = Field(32, ge=1, le=100_000, description="flights added to them in each search")
    learning_rate: float = Field(1e-3, gt=0, le=1, description="of the first search")
    device: Literal["cpu", "cuda"] = Field("cpu", description="what computes")
    threads: int = Field(1, ge=1, le=1024, description="of the CPU; results repeat bit for bit with one")


class AlgorithmSettings(Settings):
    """Algorithm 1's settings."""

    steps: StepSizes
    window: int = Field(1, ge=1, le=1000, description="l: demonstrations in a gradient")
    expectation: Literal["sampled", "exact"] = Field("sampled", description="rollouts, or the occupancy measure")
    rollouts: int = Field(100, ge=1, le=1_000_000, description="m: trajectories per gradient, where sampled")
    rollout_start: RolloutStart = Field("initial", description="roll out from P_0, or where demonstrations began")
    reward: LinearRewardSettings | NeuralRewardSettings = Field(
        LinearRewardSettings(), discriminator="kind", description="the reward model"
    )
    policy: SoftValueIterationSettings | SoftQSettings | LatticeSettings | SoftActorCriticSettings = Field(
        SoftValueIterationSettings(), discriminator="kind", description="how the policy is found"
    )


class FtlSettings(Settings):
    """Follow the leader."""

    steps: StepSizes | None = Field(None, description="step sizes; default: the algorithm's")
    tolerance: float = Field(0.3, gt=0, description="largest entry of a gradient that counts as stationary")
    most_steps: int = Field(50, ge=1, le=100_000, description="gradient steps per iteration")


class DlmSettings(Settings):
    """The double loop."""

    steps: StepSizes | None = Field(None, description="step sizes; default: the algorithm's")
    tolerance: float = Field(0.5, gt=0, description="largest entry of the inner gradient that counts as solved")
    most_steps: int = Field(50, ge=1, le=100_000, description="inner steps per iteration")
    window: int = Field(10, ge=1, le=1000, description="l: iterations whose demonstrations make a loss")


class MeGreedySettings(Settings):
    """Maximum-likelihood constraint inference with the true reward given."""

    least_mass: float = Field(0.01, gt=0, lt=1, description="probability that a new constraint must remove")


class MeGradientSettings(Settings):
    """Maximum-entropy constraint inference by gradient with the true reward given."""

    steps: StepSizes | None = Field(None, description="step sizes; default: the algorithm's")


class BaselineSettings(Settings):
    """The central methods that the experiment is compared with. BICS takes the settings of the algorithm."""

    ftl: FtlSettings = FtlSettings()
    dlm: DlmSettings = DlmSettings()
    me_greedy: MeGreedySettings = MeGreedySettings()
    me_gradient: MeGradientSettings = MeGradientSettings()
