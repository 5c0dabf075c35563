"""Kinds from packages that are sound, broken, rivals, or not there."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from experiments import changed

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_core.registry import GROUPS, kinds, offers, require

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
        offers.cache_clear()

    yield install
    monkeypatch.undo()
    offers.cache_clear()


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
    ],
    ids=["library", "raises", "name", "word", "nameless"],
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


def test_a_package_may_not_take_a_name_of_ours(install: Install) -> None:
    install("thief", "lattice", ":SOUND")
    with pytest.raises(ExperimentError, match="'mabirds.core', 'thief'"):
        require(PLANNERS, "lattice")
    assert "lattice" not in kinds(PLANNERS)


def test_a_name_that_nobody_brings_is_refused_with_those_there_are() -> None:
    with pytest.raises(ExperimentError, match="'magic' is none of the planners .*'lattice'.*install the package"):
        require(PLANNERS, "magic")


@pytest.mark.parametrize("group", GROUPS)
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
