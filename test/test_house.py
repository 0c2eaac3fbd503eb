"""The house: who alone prints, and what may not happen at import; which room may use which is in pyproject.toml."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import robot_ident

PACKAGE = Path(robot_ident.__file__).resolve().parent

ROS = ("rclpy", "builtin_interfaces", "rosgraph_msgs", "rcl_interfaces", "ament_index_python", "launch", "launch_ros")
WEB = ("dash", "flask", "werkzeug")
PAGES = tuple(f"robot_ident.workbench.{name}" for name in ("callbacks", "drawing", "layout", "panels", "server"))
"""The part of the workbench that is a web application; the rest of it knows no web."""
PLOTS = ("matplotlib", "plotly", "bokeh", "seaborn", "pyqtgraph")
HEAVY = ("casadi", "pinocchio", "scipy", "rclpy", "mcap", "rosbags", "joblib")


def module_name(file: Path) -> str:
    parts = ("robot_ident", *file.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def room(module: str) -> str:
    """Return the room of `robot_ident.ROOM...`; empty for the package itself."""
    return (module.split(".") + [""])[1]


FILES = {module_name(file): file for file in sorted(PACKAGE.rglob("*.py"))}


@cache
def tree_of(module: str) -> ast.Module:
    return ast.parse(FILES[module].read_text(encoding="utf-8"), str(FILES[module]))


def imports(module: str) -> Iterator[tuple[str, int]]:
    """Yield what a module imports, at its top or late, as full names with their line."""
    parts = module.split(".")
    package = parts if FILES[module].name == "__init__.py" else parts[:-1]
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            origin = ".".join(filter(None, (base, node.module)))
            for alias in node.names:
                inner = f"{origin}.{alias.name}"
                yield inner if inner in FILES else origin, node.lineno


def test_every_folder_is_a_package() -> None:
    """A folder without `__init__.py` would be left out of what is installed."""
    bare = {str(file.parent) for file in FILES.values() if not (file.parent / "__init__.py").is_file()}
    assert not bare


def test_no_circle_within_a_room() -> None:
    """A circle of imports at the top of modules works only until someone imports them in another order."""
    edges = {module: {name for name, _ in top_imports(module) if name in FILES} for module in FILES}
    state: dict[str, int] = {}

    def visit(module: str, path: tuple[str, ...]) -> None:
        assert state.get(module) != 1, "a circle of imports: " + " -> ".join((*path[path.index(module) :], module))
        if module in state:
            return
        state[module] = 1
        for name in sorted(edges[module]):
            if not module.startswith(name + "."):  # a package is always imported before what is in it
                visit(name, (*path, module))
        state[module] = 2

    for module in FILES:
        visit(module, ())


def top_imports(module: str) -> Iterator[tuple[str, int]]:
    late = {
        inner.lineno
        for node in ast.walk(tree_of(module))
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) or _is_type_checking(node)
        for inner in ast.walk(node)
        if isinstance(inner, (ast.Import, ast.ImportFrom))
    }
    return ((name, line) for name, line in imports(module) if line not in late)


def _is_type_checking(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)


def calls(module: str) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree_of(module)):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node.lineno


def test_cli_alone_prints() -> None:
    """Nodes are programs of their own: they may exit and write why, the core and the bags may not even that."""
    talk = {"print", "input"}
    more = talk | {"exit", "quit", "sys.exit", "os._exit", "sys.stdout.write", "sys.stderr.write"}
    wrong = [
        f"{module}:{line} calls {name}"
        for module in FILES
        if room(module) != "cli"
        for name, line in calls(module)
        if name in (talk if room(module) == "nodes" else more)
    ]
    assert not wrong


def test_what_tests_scripts_and_examples_import_exists(checkout: Path) -> None:
    """A moved name that a function or notebook imports fails half an hour into a run: told here at once."""
    sources = {
        file: file.read_text(encoding="utf-8")
        for folder in ("test", "acceptance", "benchmarks", "examples", "scripts")
        for file in (checkout / folder).rglob("*.py")
    }
    for file in (checkout / "examples").glob("*.ipynb"):
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        sources[file] = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    missing = [
        f"{file}: {node.module}.{alias.name}"
        for file, source in sources.items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("robot_ident.")
        for alias in node.names
        if f"{node.module}.{alias.name}" not in FILES and alias.name not in top_names(node.module or "")
    ]
    assert sources
    assert not missing


@cache
def top_names(module: str) -> set[str]:
    """Return the names that a module defines or imports outside its functions and classes."""
    names: set[str] = set()
    pending: list[ast.AST] = [tree_of(module)] if module in FILES else []
    while pending:
        for node in ast.iter_child_nodes(pending.pop()):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Import | ast.ImportFrom):
                names |= {alias.asname or alias.name for alias in node.names}
            else:
                names |= {node.id} if isinstance(node, ast.Name) else set()
                pending.append(node)
    return names


def test_no_wildcard_and_no_bare_except() -> None:
    for module in FILES:
        for node in ast.walk(tree_of(module)):
            assert not (isinstance(node, ast.ExceptHandler) and node.type is None), f"{module}:{node.lineno}"
            assert not (isinstance(node, ast.ImportFrom) and node.names[0].name == "*"), f"{module}:{node.lineno}"


def test_files_stay_small() -> None:
    large = {module: lines for module, file in FILES.items() if (lines := len(file.read_text().splitlines())) > 600}
    assert not large, "each asks to be two"


BLOCKED = """
import sys
class Block:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        if top in {blocked!r} or {no_ros} and top.endswith(("_msgs", "_srvs")):
            raise ModuleNotFoundError(f"{{name}} was imported", name=name)
sys.meta_path.insert(0, Block())
sys.argv = ["robot_ident", "--no-such-option"]
import importlib
for module in {modules!r}:
    importlib.import_module(module)
heavy = sorted(set({heavy!r}) & set(sys.modules))
assert not heavy, f"imported early: {{heavy}}"
"""


def run_imports(modules: list[str], blocked: tuple[str, ...], heavy: tuple[str, ...] = ()) -> None:
    """Import modules in a Python of their own, where some libraries are missing; nothing may be printed."""
    program = BLOCKED.format(modules=modules, blocked=blocked, heavy=heavy, no_ros="rclpy" in blocked)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, cwd=PACKAGE.parent
    )
    assert done.returncode == 0, done.stderr
    assert (done.stdout, done.stderr) == ("", ""), "something is printed at import"


def test_all_but_the_nodes_imports_without_ros_and_plots() -> None:
    modules = [m for m in FILES if room(m) not in ("nodes", "__main__") and not m.startswith(PAGES)]
    run_imports(modules, (*ROS, *PLOTS, *WEB))


def test_nodes_import_silently() -> None:
    run_imports([m for m in FILES if room(m) == "nodes"], PLOTS)


def test_command_line_starts_light() -> None:
    """`robot_ident --help` is instant only while the heavy libraries come late."""
    run_imports(["robot_ident.cli.main"], (*ROS, *PLOTS), HEAVY)
