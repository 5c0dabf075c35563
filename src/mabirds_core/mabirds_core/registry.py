"""Kinds of games, rewards, costs, planners, methods, schedules, mixers and step rules, from packages that bring them.

A package names its kinds as entry points, in one of GROUPS, each pointing to a ``Kind``:

    [project.entry-points."mabirds.games"]
    junction = "mabirds_junction.kind:JUNCTION"

Nothing is registered by importing it. Of kinds, those are loaded that an experiment file names (kind_settings); what is
built from their settings is loaded where it is built. So a process has only what its experiment needs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, reduce
from importlib.metadata import Distribution, EntryPoint, EntryPoints, distribution, distributions
from itertools import groupby
from operator import attrgetter, or_
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag

from mabirds_core.errors import ExperimentError
from mabirds_core.settings import Settings

GROUPS = MappingProxyType(
    {
        "mabirds.games": "games",
        "mabirds.rewards": "rewards",
        "mabirds.costs": "costs",
        "mabirds.cost_features": "cost features",
        "mabirds.planners": "planners",
        "mabirds.methods": "methods",
        "mabirds.schedules": "schedules",
        "mabirds.mixers": "mixers",
        "mabirds.step_rules": "step rules",
    }
)
"""Entry point groups, and what each holds."""

METHODS = "mabirds.methods"


@dataclass(frozen=True)
class Kind:
    """What an entry point names: settings as written in an experiment file, and what is built from them.

    ``build`` takes the settings first, then what the group says (docs/your-own-game.md): games nothing more, rewards
    and costs the game, cost features where experts are, planners the game and the reward model, methods the
    parts of a method, schedules the learners' names.
    """

    settings: type[Settings]
    build: Callable[..., Any]
    form: str | None = None
    """Of games: how they can be planned in ("tabular", ...). Of planners: which games they are made for; None: all."""
    check: Callable[..., None] | None = None
    """Of planners and costs: ``check(settings, game)`` raises ExperimentError where the two do not fit."""
    default: bool = False
    """Whether settings that name no kind are of this one."""
    sample: Callable[..., Settings] | None = None
    """Of games: ``sample(rng)`` draws settings at random, for benchmarks on games that nobody tuned for."""
    recorded: Callable[..., dict[str, Any]] | None = None
    """Of games: ``recorded(observed)`` is what an experiment file says of a game that recordings are imported to."""


class Offer(NamedTuple):
    """A kind that is installed: its name, the package that brings it, and what became of loading it."""

    group: str
    name: str
    package: str
    version: str
    target: str
    kind: Kind | None
    problem: str
    """Why it cannot be used; empty: it can."""


PREFIX = "[mabirds."
"""How our groups are written in the files of entry points."""


@cache
def installed_points() -> EntryPoints:
    """Entry points of the packages that bring kinds.

    To look through all takes longer than to load what is found, so that other packages' are not parsed. Where a package
    is installed in several places, it is the first of these that counts, as everywhere.
    """
    names = {found.name for found in distributions() if PREFIX in (found.read_text("entry_points.txt") or "")}
    return EntryPoints(point for name in sorted(names) for point in distribution(name).entry_points)


@cache
def _origin(distribution: Distribution) -> tuple[str, str]:
    return distribution.name, distribution.version


@cache
def points_of(group: str) -> Mapping[str, Sequence[EntryPoint]]:
    """Entry points of a group by name: one each, unless several packages bring it. Nothing is loaded."""
    points = sorted(installed_points().select(group=group), key=attrgetter("name", "value"))
    return MappingProxyType({name: tuple(named) for name, named in groupby(points, attrgetter("name"))})


@cache
def offer(group: str, name: str) -> Offer | None:
    """An installed kind, loaded alone.

    Parameters
    ----------
    group : str
        One of GROUPS.
    name : str
        Of its entry point.

    Returns
    -------
    Offer or None
        None where there is none of this name.
    """
    points = points_of(group).get(name)
    return _offer(points[-1], points if len(points) > 1 else ()) if points else None


@cache
def offers(group: str) -> Mapping[str, Offer]:
    """All installed kinds of a group by name, also those that cannot be used."""
    found = {name: offer(group, name) for name in points_of(group)}
    return MappingProxyType({name: one for name, one in found.items() if one})


def forget() -> None:
    """Look for kinds again, where packages have been installed since."""
    for known in (installed_points, points_of, offer, offers):
        known.cache_clear()


def kinds(group: str) -> dict[str, Kind]:
    """The usable kinds of a group by name."""
    return {name: offer.kind for name, offer in offers(group).items() if offer.kind}


def kind_of(group: str, settings: Any) -> Kind:
    """The kind that parsed some settings.

    Parameters
    ----------
    group : str
        One of GROUPS.
    settings : Any
        As read from an experiment file.

    Returns
    -------
    Kind
        Of ``settings.kind``.
    """
    return require(group, settings.kind)


def build(group: str, settings: Any, *parts: Any) -> Any:
    """Build what settings describe.

    Parameters
    ----------
    group : str
        One of GROUPS.
    settings : Any
        As read from an experiment file.
    *parts : Any
        What the group says, see ``Kind``.

    Returns
    -------
    Any
        A game, a reward model, and so on.
    """
    return kind_of(group, settings).build(settings, *parts)


def require(group: str, name: str) -> Kind:
    """A kind by name.

    Parameters
    ----------
    group : str
        One of GROUPS.
    name : str
        Of its entry point.

    Returns
    -------
    Kind
        One that can be used.

    Raises
    ------
    ExperimentError
        There is none; the message says which there are, or which package's kind fails and how.
    """
    found = offer(group, name)
    if found is None:
        raise ExperimentError(f"{name!r} is none of the {GROUPS[group]} {sorted(kinds(group))}{REMEDY}")
    if found.kind is None:
        raise ExperimentError(f"{name!r}: {found.problem}")
    return found.kind


REMEDY = "; install the package that brings it (`mabirds kinds` lists what there is)"


def union(group: str) -> Any:
    """The type of a setting that may be of any kind of a group.

    Parameters
    ----------
    group : str
        One of GROUPS.

    Returns
    -------
    Any
        A tagged union of their models.

    Raises
    ------
    ExperimentError
        None is installed.
    """
    members = {name: kind.settings for name, kind in kinds(group).items()}
    distinct = list(dict.fromkeys(members.values()))
    if not distinct:
        raise ExperimentError(f"no {GROUPS[group]} are installed; install mabirds_core again, which brings some")
    if len(distinct) == 1:  # pydantic tells several apart, and no single one
        return distinct[0]
    default = next((name for name, kind in kinds(group).items() if kind.default), None)
    if default is None:
        return Annotated[reduce(or_, distinct), Field(discriminator="kind")]
    tagged = [Annotated[model, Tag(name)] for name, model in members.items()]
    return Annotated[reduce(or_, tagged), Discriminator(_tag_or(default))]


TEXT = "text"
"""How errors call what is no kind but a text."""


def text_or_union(group: str) -> Any:
    """The type of a setting that is a text, or settings of any kind of a group."""
    members = {name: kind.settings for name, kind in kinds(group).items()}
    if not members:  # pydantic tells several apart, and no single one
        return Annotated[str, BeforeValidator(_only_text(group))]
    tagged = [Annotated[str, Tag(TEXT)], *(Annotated[model, Tag(name)] for name, model in members.items())]
    return Annotated[reduce(or_, tagged), Discriminator(_tag_or(TEXT))]


def _only_text(group: str) -> Callable[[Any], Any]:
    def checked(given: Any) -> Any:
        if isinstance(given, dict):
            raise ValueError(f"{given.get('kind')!r} is none of the {GROUPS[group]} []{REMEDY}")  # noqa: TRY004 - pydantic's
        return given

    return checked


def _tag_or(default: str) -> Callable[[Any], str]:
    def kind_named(settings: Any) -> str:
        if isinstance(settings, dict):
            return str(settings.get("kind", default))
        return str(getattr(settings, "kind", default))

    return kind_named


def _offer(point: EntryPoint, rivals: Sequence[EntryPoint]) -> Offer:
    package, version = _origin(point.dist) if point.dist else ("?", "?")
    kind, problem = _loaded(point, package)
    others = sorted({_origin(rival.dist)[0] for rival in rivals if rival.name == point.name and rival.dist})
    if others:
        kind, problem = None, f"several packages bring it, {others}; uninstall all but one"
    return Offer(point.group, point.name, package, version, point.value, kind, problem)


def _loaded(point: EntryPoint, package: str) -> tuple[Kind | None, str]:
    """The kind, or why there is none. A stranger's import may raise anything, and must not end the others' programs."""
    try:
        kind = point.load()
    except Exception as error:  # noqa: BLE001
        return None, f"package {package} cannot load {point.value} ({type(error).__name__}: {error}); mend or remove it"
    if not isinstance(kind, Kind):
        return None, f"package {package}: {point.value} is {type(kind).__name__}, expected a Kind; mend or remove it"
    if point.group == METHODS:  # their settings stand under their names
        return kind, ""
    field = kind.settings.model_fields.get("kind")
    if field is None or point.name not in get_args(field.annotation):
        words = f"expected a field kind: Literal[{point.name!r}] in {kind.settings.__name__}"
        return None, f"package {package}: {words}; mend or remove it"
    return kind, ""
