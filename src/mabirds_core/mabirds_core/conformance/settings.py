"""Checks of settings."""

from mabirds_core.conformance.expectations import fails, require
from mabirds_core.registry import Kind
from mabirds_core.settings import Settings


def check_settings(kind: Kind, content: dict[str, object]) -> Settings:
    """Check that settings are read, refused where misspelt, and cannot be changed.

    Parameters
    ----------
    kind : Kind
        With the settings' model.
    content : dict[str, object]
        As of an experiment file.

    Returns
    -------
    Settings
        The settings of ``content``.
    """
    model = kind.settings
    settings = model.model_validate(content)
    again = model.model_validate_json(settings.model_dump_json())
    require(again == settings, f"{model.__name__}: written as JSON and read again, it is another")
    require(fails(lambda: model.model_validate({**content, "mispelt": 1})), f"{model.__name__} takes unknown names")
    name = next(iter(model.model_fields))
    require(fails(lambda: setattr(settings, name, None)), f"{model.__name__} can be changed")
    return settings
