"""The player's parameters as options of verbs: names, ranges and help are those of the node."""

import inspect
from collections.abc import Callable, Iterator
from functools import wraps
from typing import Annotated, Any

import typer

from mabirds_expert_player.player_parameters import FLAGS, LISTS, NUMBERS, TEXTS, WHOLE_NUMBERS

OF_THE_NETWORK = ("baseline", "bag_digest")
"""Parameters that a verb sets by itself."""

LESS_THAN_ALL = ("playback_duration", "playback_until", "include", "exclude", "listeners", "loop", "stay", "bag")
"""Parameters with which a player may end before all is learned, or never, so that a run would not end either."""


def player_options(*left_out: str) -> dict[str, inspect.Parameter]:
    """Options by parameter of the player.

    Parameters
    ----------
    *left_out : str
        Parameters that are no options.

    Returns
    -------
    dict[str, inspect.Parameter]
        As typer reads them.
    """
    return {name: option for name, option in _all_options() if name not in (*OF_THE_NETWORK, *left_out)}


def _all_options() -> Iterator[tuple[str, inspect.Parameter]]:
    for name, (default, lowest, highest, words) in {**NUMBERS, **WHOLE_NUMBERS}.items():
        yield _option(name, type(default), default, typer.Option(help=_sentence(words), min=lowest, max=highest))
    for name, words in FLAGS.items():
        yield _option(name, bool, False, typer.Option(f"--{name.replace('_', '-')}", help=_sentence(words)))
    for name, words in TEXTS.items():
        yield _option(name, str, "", typer.Option(help=_sentence(words)))
    for name, words in LISTS.items():
        help_text = f"{_sentence(words)} May be given several times."
        yield _option(name, list[str] | None, None, typer.Option(help=help_text))


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}."


def _option(name: str, kind: Any, default: Any, option: Any) -> tuple[str, inspect.Parameter]:
    annotation = Annotated[kind, option]
    return name, inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def takes_player_options(*left_out: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a verb the player's options; it gets those that are set as its argument ``player``.

    Parameters
    ----------
    *left_out : str
        Parameters that are no options of this verb.

    Returns
    -------
    Callable
        A decorator.
    """
    options = player_options(*left_out)

    def decorate(verb: Callable[..., Any]) -> Callable[..., Any]:
        @wraps(verb)
        def with_options(**given: Any) -> Any:
            player = {name: given.pop(name) for name in options}
            chosen = {name: value for name, value in player.items() if value not in (options[name].default, [])}
            return verb(**given, player=chosen)

        own = [parameter for name, parameter in inspect.signature(verb).parameters.items() if name != "player"]
        parameters = [parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY) for parameter in own]
        with_options.__signature__ = inspect.Signature([*parameters, *options.values()])  # type: ignore[attr-defined]
        with_options.__annotations__ = {p.name: p.annotation for p in (*parameters, *options.values())}
        return with_options

    return decorate
