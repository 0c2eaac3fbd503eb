"""Closed YAML files: every field has a type, a default, a bound and a description; an unknown key is an error.

All problems of a file are reported at once, each with the field and the value that it found.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any, TypeVar

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from robot_ident.errors import InputError, did_you_mean
from robot_ident.files import read_text

ALTERNATIVE = "|"
"""How the tag of one of several types of a field begins, which is no part of the field's name."""


class Closed(BaseModel):
    """A record read from YAML: frozen, finite numbers only, unknown keys refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


T = TypeVar("T", bound=Closed)

# what PyYAML raises on scalars that their tag or their look makes numbers, dates or bytes, which they are not
_UNREADABLE = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, RecursionError)
_LONGEST = 1000  # characters of a number; Python refuses to show longer ones
_LARGEST = 1e30
_DEEPEST = 50  # levels of nesting; libyaml's composer, which knows no limit, dies on a hundred thousand


class NotYaml(ValueError):
    """A text that is no YAML, or none of the kind that people write: too deep, a key twice, an alias."""


def load_yaml(text: str, *, aliases: bool = False) -> Any:
    """Return what a YAML text holds; NotYaml, in one line, where it holds nothing that can be used.

    aliases: let `*name` stand, a few of which can unfold to any size; for files of others, which nobody unfolds.
    """
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _look_through(yaml.parse(text, Loader=loader), aliases)
        return yaml.load(text, Loader=loader)
    except NotYaml:
        raise
    except (yaml.YAMLError, *_UNREADABLE) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}" if mark else ""
        problem = getattr(error, "problem", None) or (str(error).splitlines() or [type(error).__name__])[0]
        raise NotYaml(f"not YAML{where}: {problem}") from error


def _is_endless_number(word: yaml.ScalarEvent) -> bool:
    return len(word.value) > _LONGEST and bool(word.implicit[0] or word.tag) and word.value[0] in "+-.0123456789"


def _look_through(events: Iterable[yaml.Event], aliases: bool) -> None:
    """Raise NotYaml where a text must not be loaded."""
    levels: list[tuple[set[str] | None, int]] = []  # keys of each open mapping (None: a list), and nodes so far
    for event in events:
        line = event.start_mark.line + 1 if event.start_mark else 0
        if isinstance(event, yaml.CollectionEndEvent):
            levels.pop()
            continue
        if not isinstance(event, yaml.NodeEvent):
            continue
        if isinstance(event, yaml.AliasEvent) and not aliases:
            name = str(event.anchor)[:60]
            raise NotYaml(f"line {line}: aliases (*{name}) are not used in these files; quote the text if it is one")
        word = event if isinstance(event, yaml.ScalarEvent) else None
        if word is not None and _is_endless_number(word):
            raise NotYaml(f"line {line}: a number of {len(word.value)} characters")
        if levels:
            keys, nodes = levels[-1]
            levels[-1] = keys, nodes + 1
            if keys is not None and nodes % 2 == 0 and word is not None:
                if word.value in keys:
                    raise NotYaml(f"line {line}: the key {word.value[:60]!r} stands there twice")
                keys.add(word.value)
        if isinstance(event, yaml.CollectionStartEvent):
            levels.append((set() if isinstance(event, yaml.MappingStartEvent) else None, 0))
            if len(levels) > _DEEPEST:
                raise NotYaml(f"line {line}: more than {_DEEPEST} levels lie within one another")


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML mapping; InputError names the file and the line when it is none."""
    path = Path(path)
    try:
        data = load_yaml(read_text(path))
    except NotYaml as error:
        raise InputError(f"{path}: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"{path}: a YAML mapping was expected, found {type(data).__name__}")
    if large := next(_too_large(data), ""):
        raise InputError(f"{path}: {large}: no quantity in these files is beyond {_LARGEST:.0e}")
    return data


def _too_large(data: Any, field: str = "") -> Iterator[str]:
    """Yield the fields, with their values, whose squares and products would leave double precision."""
    if isinstance(data, (dict, list)):
        for key, value in data.items() if isinstance(data, dict) else enumerate(data):
            yield from _too_large(value, f"{field}.{key}" if field else str(key))
    elif isinstance(data, (int, float)) and _LARGEST < abs(data) < float("inf"):
        yield f"{field} = {data!r:.60}"


def line_of(path: Path | str, entry: str) -> int | None:
    """Return the line of an entry (`joints.elbow.effort`) in a YAML file, of the deepest part of it that is there;
    None where none is, or the file can't be read.
    """
    try:
        node: Any = yaml.compose(read_text(path), Loader=yaml.SafeLoader)
    except (InputError, yaml.YAMLError):
        return None
    line = None
    for word in entry.split("."):
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        found = next(((key, value) for key, value in pairs if key.value == word), None)
        if found is None:
            break
        line, node = found[0].start_mark.line + 1, found[1]
    return line


def parse(record: type[T], data: dict[str, Any], source: Path | str) -> T:
    """Validate `data` as `record`; one InputError lists every problem with its field and value."""
    try:
        return record.model_validate(data)
    except ValidationError as error:
        problems = "; ".join(_problem(record, item) for item in error.errors(include_url=False))
        raise InputError(f"{source}: {problems}") from error


def _problem(record: type[BaseModel], item: Any) -> str:
    loc = [str(part) for part in item["loc"] if not str(part).startswith(ALTERNATIVE)]
    field = ".".join(loc) or "file"
    if item["type"] == "extra_forbidden":
        known = record.model_fields if len(loc) == 1 else ()
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
