"""Pages of settings, from the JSON schemas of experiment and study files."""

from collections.abc import Iterator, Mapping
from typing import Any

from markdown_text import code, table
from pydantic import BaseModel

from mabirds_bringup.bench.study import Study, packaged_studies
from mabirds_core.experiment.file import Experiment


def settings_page() -> str:
    """Every model of the JSON schema of an experiment, the experiment first."""
    words = "An experiment is one YAML file. A misspelt name, or a value that does not fit, is refused with its remedy."
    return _models_page("Experiment files", words, Experiment)


def studies_page() -> str:
    """Every model of the JSON schema of a study, the study first."""
    words = f"A study is one YAML file for `mabirds bench`. The package has {', '.join(map(code, packaged_studies()))}."
    return _models_page("Study files", words, Study)


def _models_page(title: str, words: str, first: type[BaseModel]) -> str:
    schema = first.model_json_schema()
    names = list(dict.fromkeys(_reachable(schema, schema["$defs"])))
    models = {first.__name__: schema, **{name: schema["$defs"][name] for name in names}}
    sections = [_model_section(name, model) for name, model in models.items() if "properties" in model]
    return "\n".join([f"# {title}", "", words, "", *sections])


def _reachable(part: Any, models: Mapping[str, Any]) -> Iterator[str]:
    """Names of models in the order in which an experiment file has them."""
    if isinstance(part, dict) and "$ref" in part:
        name = part["$ref"].rpartition("/")[2]
        yield name
        yield from _reachable(models[name], models)
    elif isinstance(part, dict | list):
        for inner in part.values() if isinstance(part, dict) else part:
            yield from _reachable(inner if inner is not models else {}, models)


def _model_section(name: str, model: Mapping[str, Any]) -> str:
    required = model.get("required", ())
    rows = [
        (code(key), _type(setting), "required" if key in required else _json_default(setting), _meaning(setting))
        for key, setting in model["properties"].items()
    ]
    about = model.get("description", "").partition(">>>")[0].strip()
    return f"## {name}\n\n{about}\n\n{table(('name', 'type', 'default', 'meaning'), rows)}"


def _type(setting: Mapping[str, Any]) -> str:
    """The type of a setting, with links to models."""
    if "$ref" in setting:
        name = setting["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    for several in ("oneOf", "anyOf"):
        if several in setting:
            return " or ".join(_type(kind) for kind in setting[several])
    if "const" in setting or "enum" in setting:
        return " or ".join(code(value) for value in setting.get("enum", [setting.get("const")]))
    if setting.get("type") == "array":
        inner = setting.get("prefixItems")
        return f"list of {len(inner)}: {_type(inner[0])}" if inner else f"list of {_type(setting.get('items', {}))}"
    names = {"number": "number", "integer": "integer", "string": "text", "boolean": "true or false", "null": "nothing"}
    return names.get(str(setting.get("type")), "anything")


def _json_default(setting: Mapping[str, Any]) -> str:
    default = setting.get("default")
    if isinstance(default, dict):
        return code(default["kind"]) if "kind" in default else "its defaults"
    return "" if default is None else code(str(default).lower() if isinstance(default, bool) else default)


BOUNDS = {
    "minimum": "at least {}",
    "exclusiveMinimum": "more than {}",
    "maximum": "at most {}",
    "exclusiveMaximum": "less than {}",
    "minItems": "at least {} of them",
    "maxItems": "at most {} of them",
    "pattern": "of the form `{}`",
}


def _meaning(setting: Mapping[str, Any]) -> str:
    bounds = ", ".join(words.format(setting[key]) for key, words in BOUNDS.items() if key in setting)
    return "; ".join(part for part in (str(setting.get("description", "")), bounds) if part)
