"""The player as a program, and experts that know the way."""

import subprocess
import sys

import numpy as np

from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.tabular.experts import OptimalExperts
from mabirds_core.planners.occupancy import rollouts
from mabirds_expert_player.player_help import HELP


def test_the_program_says_what_it_takes_and_refuses_to_play_nothing() -> None:
    command = [sys.executable, "-m", "mabirds_expert_player"]
    told = subprocess.run([*command, "--help"], capture_output=True, text=True, timeout=60, check=False)
    assert (told.returncode, told.stdout.strip()) == (0, HELP.strip())
    refused = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert refused.returncode == 2
    assert "the parameter experiment is not set" in refused.stderr


def test_experts_walk_around_what_they_may_not_enter() -> None:
    settings = {"map": "...\n.#.", "starts": (((1, 0),),), "goals": ((1, 2),), "horizon": 5}
    game = PatrolGame(PatrolSettings(kind="patrol", **settings))
    walks = rollouts(game, OptimalExperts(game), 3, np.random.default_rng(1))
    assert game.cells(walks.states)[0].tolist() == [[3, 0, 1, 2, 5, 5]] * 3
