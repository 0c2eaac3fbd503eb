"""Effects that users write in a file of their own."""

from __future__ import annotations

import sys
from contextlib import redirect_stdout
from hashlib import sha256
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from types import ModuleType

from robot_ident.effects.catalogue import CATALOGUE
from robot_ident.effects.check import problems
from robot_ident.effects.effect import Effect
from robot_ident.effects.own import line_in, origin
from robot_ident.errors import InputError
from robot_ident.files import read_bytes


def load_effects(path: Path | str, source: bytes | None = None) -> dict[str, type[Effect]]:
    """Return the effects that a Python file defines, by name; `register` adds them to the catalogue.

    The file runs as a module of a private name, and what it prints goes to standard error; source: its contents, where
    they were read elsewhere. Raises InputError where it can't be read or run, defines no subclass of Effect, or defines
    one with something missing or with a name that is taken.
    """
    path = Path(path)
    module = _run(path, read_bytes(path) if source is None else source)
    found: dict[str, type[Effect]] = {}
    for kind in vars(module).values():
        if not (isinstance(kind, type) and issubclass(kind, Effect) and kind.__module__ == module.__name__):
            continue
        if kind.__name__.startswith("_"):
            continue
        wrong = problems(kind)
        if wrong:
            raise InputError(f"{path}: class {kind.__name__}: {'; '.join(wrong)}")
        taken = found.get(kind.name) or CATALOGUE.get(kind.name)
        if (
            taken is not None
            and taken is not kind
            and (origin(taken), taken.__name__) != (str(path.resolve()), kind.__name__)
        ):
            raise InputError(f"{path}: class {kind.__name__}: the name {kind.name!r} is taken; give the effect another")
        found[kind.name] = kind
    if not found:
        raise InputError(f"{path}: defines no subclass of robot_ident.effects.Effect")
    for kind in found.values():
        unknown = [name for name in kind.confused_with if name not in CATALOGUE and name not in found]
        if unknown:
            raise InputError(f"{path}: class {kind.__name__}: confused_with names an unknown effect {unknown[0]!r}")
    return found


def _run(path: Path, source: bytes) -> ModuleType:
    """Run a file once as a module; the same file with the same contents is the same module again."""
    name = "_robot_ident_effects_" + sha256(str(path.resolve()).encode() + source).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_loader(name, loader=None, origin=str(path))
    assert spec is not None  # a name and no loader always give one
    module = module_from_spec(spec)
    module.__file__ = str(path.resolve())
    try:
        code = compile(source, str(path), "exec")
    except (SyntaxError, ValueError) as error:
        where = f"{path}, line {error.lineno}" if isinstance(error, SyntaxError) else str(path)
        raise InputError(f"{where}: {error.msg if isinstance(error, SyntaxError) else error}") from error
    sys.modules[name] = module
    try:
        with redirect_stdout(sys.stderr):  # where one JSON object may be all that standard output holds
            exec(code, vars(module))
    except (Exception, SystemExit) as error:  # whatever a user's file does wrong is an error of that file
        del sys.modules[name]
        raise InputError(f"{path}{line_in(str(path), error)}: {type(error).__name__}: {error}") from error
    return module
