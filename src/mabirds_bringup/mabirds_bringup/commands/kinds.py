"""``mabirds kinds``: which games, rewards, costs, planners and other kinds are installed."""

from rich.table import Table

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, guarded_output, print_json
from mabirds_core.registry import GROUPS, offers


def kinds(as_json: Json = False) -> None:
    """List what experiment files can name, and which package brings each.

    Example: mabirds kinds
    """
    installed = [(words, offer) for group, words in GROUPS.items() for offer in offers(group).values()]
    with guarded_output() as stdout:
        if as_json:
            columns = ("name", "package", "version", "problem")
            content = [{"group": words} | {key: getattr(offer, key) for key in columns} for words, offer in installed]
            print_json({"kinds": content}, stdout)
            return
        table = Table("kind of", "name", "package", "what it is")
        for words, offer in installed:
            summary = (offer.kind.settings.__doc__ or "").splitlines()[0] if offer.kind else f"[red]{offer.problem}"
            table.add_row(words, offer.name, f"{offer.package} {offer.version}", summary)
        console.print(table)
