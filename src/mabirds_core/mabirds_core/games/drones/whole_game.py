"""The drone game with all that experiments ask of a game."""

import math
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.extras import require
from mabirds_core.games.drones.arrival import ArrivingDroneReward, ArrivingNeuralDroneReward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.judge import RolloutJudge
from mabirds_core.games.drones.learned_costs import measures
from mabirds_core.games.drones.nodes import Shape
from mabirds_core.games.drones.planner_checks import fits, is_guided, spacing_of, suits_lattice
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.games.drones.recorded import fit_places, followed
from mabirds_core.games.drones.rewards import DroneRewardModel, LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import SampledDroneOccupancy
from mabirds_core.games.drones.scene import DroneScene
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Fit
from mabirds_core.games.whole_game import Experts, Learned
from mabirds_core.planners.interface import Planner
from mabirds_core.registry import build

if TYPE_CHECKING:
    from mabirds_core.games.drones.held_out import HeldOutFlights

JUDGES: tuple[tuple[Shape, int], ...] = (("hexagonal", 4), ("square", 5), ("hexagonal", 7))
"""Shapes of lattices, and squares of how many spacings a step's way has: 19, 21 and 31 moves."""

DRONES, SAC = "mabirds_core[drones]", "mabirds_core[sac]"
"""What brings scipy, and what brings torch besides."""


class WholeDroneGame(DroneGame):
    """``games.whole_game.Game`` of drones."""

    expectations = ("sampled",)
    expert_kinds = ("pilots",)

    @cached_property
    def scene(self) -> DroneScene:
        """The arena from above."""
        return DroneScene(self)

    @cached_property
    def judge(self) -> RolloutJudge:
        """The judge of policies, by their rollouts."""
        return RolloutJudge(self)

    def expectation(self, kind: str, count: int) -> SampledDroneOccupancy:  # noqa: ARG002 - there is no other
        """The estimator of expectations: means over ``count`` rollouts."""
        return SampledDroneOccupancy(self, count)

    def linear_reward(self) -> LinearDroneReward:
        """theta^T f."""
        return LinearDroneReward(self)

    def arriving_reward(self) -> ArrivingDroneReward:
        """theta^T f, and a parameter for each drone that comes too late."""
        return ArrivingDroneReward(self)

    def neural_reward(self, hidden: int, bound: float) -> NeuralDroneReward:
        """A network for each drone's place."""
        require("torch", "a neural reward of drones", SAC)
        return NeuralDroneReward(self, hidden, bound)

    def arriving_neural_reward(self, hidden: int, bound: float) -> ArrivingNeuralDroneReward:
        """A network for each drone's place, and a parameter for each drone that comes too late.

        Parameters
        ----------
        hidden : int
            Units of a network.
        bound : float
            Of what networks say together.

        Returns
        -------
        ArrivingNeuralDroneReward
            r_theta.
        """
        require("torch", "a neural reward of drones", SAC)
        return ArrivingNeuralDroneReward(self, hidden, bound)

    def true_reward(self) -> TrueDroneReward:
        """Minus the step cost for each drone under way."""
        return TrueDroneReward(self)

    def evaluation_planner(self, planner: Any, reward: DroneRewardModel) -> Planner:
        """On a lattice that no learner draws, where there may be one; by pairs on it; else the planner that learned."""
        if isinstance(planner, SoftActorCriticSettings) and suits_lattice(self):
            planner = LatticeSettings(kind="lattice", temperature=planner.temperature)
        if isinstance(planner, LatticeSettings):
            return build_lattice(planner, self, reward, draws=False)
        if isinstance(planner, SoftActorCriticSettings) and is_guided(planner, self):
            from mabirds_core.games.drones.guided_actor import GuidedPlanner

            return GuidedPlanner.of(self, reward, planner.temperature, draws=False)
        learned: Planner = build("mabirds.planners", planner, self, reward)
        return learned

    def judging_planners(self, planner: Any, reward: DroneRewardModel) -> Mapping[str, Planner]:
        """On lattices that are finer than those of learners, or square: none shares their corners or their rounding.

        Where no lattice suits the game, or values of a finer one do not fit into memory, there are none.
        """
        if not suits_lattice(self):
            return {}
        lattices = (
            LatticeSettings(
                kind="lattice",
                shape=shape,
                spacing=self.dynamics.reach / math.sqrt(parts),
                rotations=1,
                temperature=planner.temperature,
            )
            for shape, parts in JUDGES
        )
        return {
            f"{lattice.shape} {lattice.spacing:.3f} m": build_lattice(lattice, self, reward, draws=False)
            for lattice in lattices
            if fits(lattice, self)
        }

    def experts(self, kind: str, side: str) -> Experts:  # noqa: ARG002 - there is no other
        """Pilots, who pass obstacles on ``side``."""
        require("scipy", "pilots of drones", DRONES)
        from mabirds_core.games.drones.pilots import Pilots  # scipy is for recording, and for the lattice

        return Pilots(self, side)

    @property
    def residual_limit(self) -> float:
        """Half of what a drone flies in a step."""
        return self.dynamics.reach / 2

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """As they are; with ``observation_noise``, what is no flight is the one that follows it."""
        try:
            return super().decode(states, actions)
        except ImpossibleTrajectoryError:
            shapes = (self.horizon + 1, self.state_size), (self.horizon + 1, self.action_size)
            noisy = self.settings.observation_noise and (states.shape, actions.shape) == shapes
            if not (noisy and np.isfinite(states).all() and np.isfinite(actions).all()):
                raise
            return followed(self, states, actions)

    def fit_places(self, places: Array) -> Fit:
        """The flight that follows recorded places."""
        return fit_places(self, places)

    @property
    def held_out_judge(self) -> "HeldOutFlights":
        """Who compares policies on a lattice with flights that nobody learned from."""
        require("scipy", "judging drones by recordings", DRONES)
        from mabirds_core.games.drones.held_out import HeldOutFlights

        return HeldOutFlights(self, self.evaluation_planner)

    def measures(self, omega: Vector, demonstrations: Trajectories) -> Mapping[str, Mapping[str, float]]:
        """What obstacles and closeness are learned to cost."""
        return measures(self, omega, demonstrations)

    def figure(self, learned: Mapping[str, Learned], threshold: float, seed: int) -> Any:  # noqa: ARG002 - costs
        """The arena by name and drone: what places cost, some rollouts, and what distances cost."""
        from mabirds_core.games.drones.pictures import arena_figure  # matplotlib is for reports

        return arena_figure(self, self.judge, learned, seed)

    def demonstrations_figure(self, demonstrations: Trajectories) -> Any:
        """The arena with demonstrations of all drones."""
        from mabirds_core.games.drones.pictures import demonstrations_figure

        return demonstrations_figure(self, demonstrations)


def build_lattice(
    settings: LatticeSettings, game: DroneGame, reward: DroneRewardModel, *, draws: bool = True
) -> Planner:
    """Build the planner of the settings.

    Parameters
    ----------
    settings : LatticeSettings
        Of the planner.
    game : DroneGame
        Of drones.
    reward : DroneRewardModel
        r_theta.
    draws : bool, optional
        Does it draw a lattice for every plan, as learners do?

    Returns
    -------
    Planner
        A ``LatticePlanner``.
    """
    require("scipy", "policies of drones on a lattice", DRONES)
    from mabirds_core.games.drones.lattice import LatticePlanner  # scipy is for drones: patrols do without

    return LatticePlanner(
        game, reward, spacing_of(settings, game), settings.temperature, settings.shape, settings.rotations, draws
    )
