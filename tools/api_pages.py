"""API pages of the documentation, one per folder of the sources, filled by mkdocstrings (a hook, see mkdocs.yml)."""

from collections.abc import Iterator
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

SOURCES = Path(__file__).resolve().parents[1] / "src"
PACKAGES = ("mabirds_core", "mabirds_msgs_py")
"""What others import as a library; the other packages are programs."""


def folders() -> Iterator[tuple[str, list[str]]]:
    """Every folder with modules, as a dotted name, and its modules."""
    for package in PACKAGES:
        root = SOURCES / package
        for folder in sorted({file.parent for file in (root / package).rglob("*.py")}):
            name = ".".join(folder.relative_to(root).parts)
            modules = sorted(file.stem for file in folder.glob("*.py") if not file.stem.startswith("__"))
            if modules:
                yield name, [f"{name}.{module}" for module in modules]


def page(name: str, modules: list[str]) -> str:
    """One page: what the folder says of itself, then its modules."""
    itself = f"::: {name}\n    options:\n      show_root_heading: false"
    return "\n\n".join([f"# {name}", itself, *(f"::: {module}" for module in modules)])


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Tell mkdocstrings where the sources are, and list the pages under API."""
    for section in config.nav or ():
        if "API" in section:
            section["API"] += [{name: f"api/{name}.md"} for name, _ in folders()]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages to those of docs/."""
    for name, modules in folders():
        files.append(File.generated(config, f"api/{name}.md", content=page(name, modules)))
    return files
