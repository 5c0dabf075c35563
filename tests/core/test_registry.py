"""Kinds from packages that are sound, broken, rivals, or not there."""

from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any, Literal

import pytest
from experiments import changed
from pydantic import TypeAdapter, ValidationError

from mabirds_core import registry
from mabirds_core.consensus.generators import alternating_ring
from mabirds_core.consensus.schedule_settings import AlternatingSchedule
from mabirds_core.consensus.strict import StrictMixer, StrictMixing
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_core.registry import (
    GROUPS,
    Kind,
    build,
    forget,
    kind_of,
    kinds,
    offers,
    points_of,
    require,
    text_or_union,
    union,
)
from mabirds_core.settings import Settings

PLANNERS = "mabirds.planners"
Install = Callable[..., None]

SOUND = """
from typing import Literal
from mabirds_core.registry import Kind
from mabirds_core.settings import Settings

class Sound(Settings):
    '''A planner that is never built.'''
    kind: Literal["sound"]

SOUND = Kind(Sound, lambda settings, game, reward: None, form="tabular")
NAMELESS = Kind(Settings, lambda settings: None)
WORD = "no kind"
"""


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Install]:
    """A function that installs a package with one entry point, and a source."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def install(package: str, name: str, target: str, source: str = SOUND) -> None:
        (tmp_path / f"{package}.py").write_text(source, encoding="utf-8")
        information = tmp_path / f"{package}-1.0.dist-info"
        information.mkdir()
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
        (information / "entry_points.txt").write_text(f"[{PLANNERS}]\n{name} = {package}{target}\n")
        forget()

    yield install
    monkeypatch.undo()
    forget()


def test_a_kind_of_another_package_is_there_with_its_origin(install: Install) -> None:
    install("one_sound", "sound", ":SOUND")
    offer = offers(PLANNERS)["sound"]
    assert (offer.package, offer.version, offer.problem) == ("one_sound", "1.0", "")
    assert require(PLANNERS, "sound") is offer.kind


@pytest.mark.parametrize(
    ("target", "source", "problem"),
    [
        (":SOUND", "import missing_library", "cannot load .* (ModuleNotFoundError: No module named 'missing_library')"),
        (":SOUND", "raise SystemError('so ist es')", "cannot load .* (SystemError: so ist es)"),
        (":OTHER", SOUND, "cannot load .* (AttributeError:"),
        (":WORD", SOUND, "is str, expected a Kind"),
        (":NAMELESS", SOUND, "expected a field kind: Literal['sound'] in Settings"),
        (":SOUND", SOUND.replace('"sound"', '"quiet"'), "expected a field kind: Literal['sound'] in Sound"),
    ],
    ids=["library", "raises", "name", "word", "nameless", "misnamed"],
)
def test_a_broken_package_is_named_and_the_others_go_on(
    install: Install, request: pytest.FixtureRequest, target: str, source: str, problem: str
) -> None:
    package = f"broken_{request.node.callspec.id}"
    install(package, "sound", target, source)
    with pytest.raises(ExperimentError, match=f"'sound': package {package}") as caught:
        require(PLANNERS, "sound")
    for part in problem.split(" .* "):
        assert part in str(caught.value)
    assert "mend or remove it" in str(caught.value)
    assert "sound" not in kinds(PLANNERS)
    assert "soft_value_iteration" in kinds(PLANNERS)


def test_a_name_that_two_packages_bring_is_refused_with_both(install: Install) -> None:
    install("rival_a", "sound", ":SOUND")
    install("rival_b", "sound", ":SOUND")
    with pytest.raises(ExperimentError, match="several packages bring it, .'rival_a', 'rival_b'.; uninstall all but"):
        require(PLANNERS, "sound")


def test_of_a_package_in_two_places_the_first_counts(
    install: Install, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As with an older version of the system's behind one of the user's."""
    install("one_sound", "sound", ":SOUND")
    newer = tmp_path / "first" / "one_sound-2.0.dist-info"
    newer.mkdir(parents=True)
    (newer / "METADATA").write_text("Metadata-Version: 2.1\nName: one-sound\nVersion: 2.0\n")
    monkeypatch.syspath_prepend(str(newer.parent))
    forget()
    assert "sound" not in offers(PLANNERS)


def test_a_kind_is_loaded_without_the_others_of_its_group(install: Install) -> None:
    install("never_loaded", "sound", ":SOUND", "raise SystemExit('loaded')")
    assert require(PLANNERS, "soft_value_iteration").form == "tabular"
    assert "sound" in points_of(PLANNERS)


def test_a_package_may_not_take_a_name_of_ours(install: Install) -> None:
    install("thief", "lattice", ":SOUND")
    with pytest.raises(ExperimentError, match="'mabirds.core', 'thief'"):
        require(PLANNERS, "lattice")
    assert "lattice" not in kinds(PLANNERS)


def test_a_name_that_nobody_brings_is_refused_with_those_there_are() -> None:
    with pytest.raises(ExperimentError, match="'magic' is none of the planners .*'lattice'.*install the package"):
        require(PLANNERS, "magic")
    with pytest.raises(ExperimentError) as caught:
        require("mabirds.mixers", "loud")
    assert str(caught.value) == (
        "'loud' is none of the mixers ['resilient', 'strict']; install the package that brings it"
        " (`mabirds kinds` lists what there is)"
    )


def test_an_entry_point_of_no_package_has_an_unknown_origin() -> None:
    point = EntryPoint("strict", "mabirds_core.consensus.kinds:STRICT", "mabirds.mixers")
    offer = registry._offer(point, [point])
    assert (offer.package, offer.version, offer.problem) == ("?", "?", "")
    assert (offer.group, offer.name, offer.target) == (point.group, point.name, point.value)
    assert offer.kind is require("mabirds.mixers", "strict")


def test_groups_are_told_to_users_by_what_they_hold() -> None:
    held = ["games", "rewards", "costs", "cost features", "planners", "methods", "schedules", "mixers", "step rules"]
    assert dict(GROUPS) == {f"mabirds.{name.replace(' ', '_')}": name for name in held}


def test_settings_are_built_by_their_own_kind() -> None:
    names = ("a", "b", "c")
    settings = AlternatingSchedule(kind="alternating")
    assert kind_of("mabirds.schedules", settings) is require("mabirds.schedules", "alternating")
    assert build("mabirds.schedules", settings, names) == alternating_ring(names)
    schedule = alternating_ring(names)
    assert build("mabirds.mixers", StrictMixing(), "b", schedule) == StrictMixer("b", schedule)


class Plain(Settings):
    """Settings of one kind."""

    kind: Literal["plain"] = "plain"


class Fancy(Settings):
    """Settings of another."""

    kind: Literal["fancy"] = "fancy"


def union_of(monkeypatch: pytest.MonkeyPatch, *models: type[Settings], default: type[Settings] | None = None) -> Any:
    """The union of a group that has these kinds."""
    names = {Plain: "plain", Fancy: "fancy"}
    group = {names[model]: Kind(model, lambda settings: None, default=model is default) for model in models}
    monkeypatch.setattr(registry, "kinds", lambda _group: group)
    return union("mabirds.any")


def test_a_single_kind_needs_no_tag(monkeypatch: pytest.MonkeyPatch) -> None:
    assert union_of(monkeypatch, Plain) is Plain
    assert union_of(monkeypatch, Plain, default=Plain) is Plain


def test_of_several_kinds_the_name_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = TypeAdapter(union_of(monkeypatch, Plain, Fancy))
    assert adapter.validate_python({"kind": "fancy"}) == Fancy()
    assert adapter.validate_python(Plain()) == Plain()
    with pytest.raises(ValidationError, match="Unable to extract tag using discriminator 'kind'"):
        adapter.validate_python({})


def test_without_a_name_the_default_kind_is_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    adapter = TypeAdapter(union_of(monkeypatch, Plain, Fancy, default=Fancy))
    assert adapter.validate_python({}) == Fancy()
    assert adapter.validate_python({"kind": "plain"}) == Plain()
    for settings in (Plain(), Fancy()):
        assert adapter.validate_python(settings) is settings
    with pytest.raises(ValidationError, match="does not match any of the expected tags"):
        adapter.validate_python({"kind": "loud"})


def test_a_group_without_kinds_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after an update of the sources alone, whose new entry points no installation has told of."""
    monkeypatch.setattr(registry, "kinds", lambda group: {})
    with pytest.raises(ExperimentError, match="no costs are installed; install mabirds_core again"):
        union("mabirds.costs")
    adapter = TypeAdapter(text_or_union("mabirds.cost_features"))
    assert adapter.validate_python("distance") == "distance"
    with pytest.raises(ValidationError, match="'in_sight' is none of the cost features .*install the package"):
        adapter.validate_python({"kind": "in_sight"})


OTHERS = "mabirds.cost_features"
"""Ours are expressions; kinds are brought by other packages."""


@pytest.mark.parametrize("group", sorted({*GROUPS} - {OTHERS}))
def test_every_group_has_kinds_and_all_of_ours_are_sound(group: str) -> None:
    ours = [offer for offer in offers(group).values() if offer.package.replace("-", "_") == "mabirds_core"]
    assert ours
    assert [offer.problem for offer in ours if offer.problem] == []


@pytest.mark.parametrize(
    ("changes", "place"),
    [
        ({"algorithm.policy": {"kind": "magic"}}, ("algorithm", "policy")),
        ({"game.kind": "chess"}, ("game",)),
        ({"algorithm.reward": {"kind": "money"}}, ("algorithm", "reward")),
        ({"schedule": {"kind": "never"}}, ("schedule",)),
    ],
    ids=str,
)
def test_settings_of_no_kind_are_refused_by_place(changes: dict[str, object], place: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match="does not match any of the expected tags") as caught:
        Experiment.model_validate(changed(changes))
    assert caught.value.errors()[0]["loc"] == place  # type: ignore[attr-defined]
