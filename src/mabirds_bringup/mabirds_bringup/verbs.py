"""The verbs of ``mabirds``, each loaded once it is asked for: to load all of them takes most of a second."""

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command, get_group

from mabirds_msgs_py.early import loading


class Verb(NamedTuple):
    """Where a verb is, and what the list of verbs says of it.

    Attributes
    ----------
    module : str
        In ``mabirds_bringup.commands``.
    help : str
        The first sentence of its own help.
    function : str
        Of the module; "": of the verb's own name.
    """

    module: str
    help: str
    function: str = ""


VERBS = {
    "run": Verb(
        "run", "Run an experiment: one process per learner plus the expert player, until everything is learned."
    ),
    "simulate": Verb(
        "simulate",
        "Run an experiment's learners in one process, without any network; same results to the last bit.",
    ),
    "play": Verb("play", "Play an experiment's bag to learners, or to whoever listens, until all of it is played."),
    "report": Verb(
        "report",
        "Make the report of a run from what is there: of one that was interrupted, or that is still under way.",
    ),
    "check": Verb(
        "report", "Check a run directory: digests, that it is whole, and that its summary is that of its files."
    ),
    "evaluate": Verb(
        "evaluate",
        "Judge a run by demonstrations that nobody learned from, beside baselines that learn nothing.",
    ),
    "record": Verb("record", "Record the experts of an experiment to a rosbag2 MCAP bag, one topic per learner."),
    "import": Verb(
        "import_recordings",
        "Make demonstrations and an experiment file of your own recordings, and tell what was kept and dropped, and"
        " why.",
        "import_recordings",
    ),
    "tune": Verb(
        "tune", "Choose settings, and when to stop, by cross-validation on the demonstrations that learners have."
    ),
    "inspect": Verb(
        "inspect",
        "Show the learners and players of this ROS domain.",
    ),
    "dashboard": Verb(
        "dashboard",
        "Serve a live page of a running network, until Ctrl-C: graph, curves, maps, and the player's controls.",
    ),
    "draw": Verb(
        "draw",
        "Publish what learners say as grids, markers, paths and numbers for RViz, Foxglove, PlotJuggler and Nav2.",
    ),
    "picture": Verb("draw", "Draw the grids, markers and paths of this ROS domain, from whomever they are, to a PNG."),
    "members": Verb(
        "members", "Declare the members of a running network: whom it is to go on without, or who joins it."
    ),
    "kinds": Verb("kinds", "List what experiment files can name, and which package brings each."),
    "audit": Verb("audit", "Find out what a run reveals."),
    "bag": Verb("bag", "Look at bags of demonstrations, check them, repair them."),
    "bench": Verb("bench", "Experiments over many seeds, with tables and pictures."),
    "player": Verb("player", "Control a running player: that of `mabirds play`, of `mabirds run`, or a node by hand."),
    "schedule": Verb("schedule", "Check edge schedules and write them."),
    "security": Verb("security", "Who may say and hear what: policies and keystores."),
}


class LoadedVerbs(Mapping[str, Any]):
    """Commands by name, which are loaded when they are looked up."""

    def __getitem__(self, name: str) -> Any:
        """The command of a verb."""
        with loading():
            module = import_module(f"mabirds_bringup.commands.{VERBS[name].module}")
        function = VERBS[name].function or name
        own = getattr(module, f"{name}_app", None)
        if own is not None:
            group = get_group(own)
            group.name = name
            return group
        alone = typer.Typer(add_completion=False)
        alone.command(name)(getattr(module, function))
        return get_command(alone)

    def __iter__(self) -> Iterator[str]:
        """Names in the order of the list."""
        return iter(VERBS)

    def __len__(self) -> int:
        """How many there are."""
        return len(VERBS)


class Verbs(TyperGroup):
    """The group of all verbs; its list needs none of them."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.commands: Any = LoadedVerbs()

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Say what there is.

        Parameters
        ----------
        ctx : Any
            Of the command line.
        formatter : Any
            Of the help.
        """
        self.commands = {name: TyperCommand(name, help=verb.help) for name, verb in VERBS.items()}
        super().format_help(ctx, formatter)
        self.commands = LoadedVerbs()
