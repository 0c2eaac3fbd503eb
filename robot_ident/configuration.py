"""Closed YAML files: every field has a type, a default, a bound and a description; an unknown key is an error.

All problems of a file are reported at once, each with the field and the value that it found.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from robot_ident.errors import InputError, did_you_mean


class Closed(BaseModel):
    """A record read from YAML: frozen, finite numbers only, unknown keys refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


T = TypeVar("T", bound=Closed)

_ALIAS = re.compile(r"(?m)(?:^|[\[,:-])[ \t]*\*\w")  # a few of them can unfold to any size


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML mapping; InputError names the file and the line when it is none."""
    path = Path(path)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        text = path.read_text(encoding="utf-8")
        if _ALIAS.search(text):
            raise InputError(f"{path}: aliases (*name) are not used in these files; quote the text if it is one")
        data = yaml.load(text, Loader=loader)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: can't be read as text ({error})") from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise InputError(f"{path}: not YAML{where}: {problem}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: a YAML mapping was expected, found {type(data).__name__}")
    return data


def parse(record: type[T], data: dict[str, Any], source: Path | str) -> T:
    """Validate `data` as `record`; one InputError lists every problem with its field and value."""
    try:
        return record.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(_problem(record, item) for item in error.errors(include_url=False))
        raise InputError(f"{source}: {problems}") from error


def _problem(record: type[BaseModel], item: Any) -> str:
    field = ".".join(str(part) for part in item["loc"]) or "file"
    if item["type"] == "extra_forbidden":
        known = record.model_fields if len(item["loc"]) == 1 else ()
        return f"unknown key '{field}'{did_you_mean(str(item['loc'][-1]), known)}"
    if item["type"] == "missing":
        return f"'{field}' is missing"
    value = repr(item.get("input"))
    value = value if len(value) <= 60 else value[:57] + "..."
    return f"{field} = {value}: {item['msg'].removeprefix('Value error, ')}"


def read(record: type[T], path: Path | str) -> T:
    """Read a YAML file as a `record`."""
    return parse(record, read_yaml(path), path)


def schema(name: str) -> Any:
    """Return the type of a `schema:` field that must equal `name`."""

    def same(value: str) -> str:
        if value != name:
            raise ValueError(f"this file should be of schema {name!r}")
        return value

    return Annotated[str, AfterValidator(same)]


class _Dumper(yaml.SafeDumper):
    """Writes floats exactly and lists of numbers on one line."""


def _list(dumper: yaml.SafeDumper, value: list[Any]) -> yaml.Node:
    flat = all(isinstance(item, (int, float, str)) for item in value)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", value, flow_style=flat)


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.Node:
    text = repr(float(value))
    if "e" in text and "." not in text:
        text = text.replace("e", ".0e")  # YAML 1.1 reads 1e-05 as a word
    return dumper.represent_scalar("tag:yaml.org,2002:float", text)


_Dumper.add_representer(list, _list)
_Dumper.add_representer(float, _float)


def to_yaml(data: dict[str, Any]) -> str:
    """Return `data` as YAML for people: keys in the given order, exact numbers, one line per vector."""
    return yaml.dump(data, Dumper=_Dumper, sort_keys=False, width=160, allow_unicode=True)
