"""What an installation must hold: for pip users, for `ros2 run` and for colcon."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import pytest

import robot_ident

NODES = ("trajectory_publisher", "simulated_kuka", "recorder", "estimator", "simulated_clock")
PROGRAMS = {"robot_ident": "robot_ident.cli.main:main"} | {
    f"robot_ident_{node}": f"robot_ident.nodes.start:{node}" for node in NODES
}


@pytest.fixture(scope="module")
def package_xml(checkout: Path) -> ElementTree.Element:
    return ElementTree.parse(checkout / "package.xml").getroot()


@pytest.fixture(scope="module")
def built(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the sdist and the wheel that is made from it, as they would be published."""
    folder = tmp_path_factory.mktemp("dist")
    source = folder / "source"
    shutil.copytree(checkout, source, ignore=shutil.ignore_patterns(".*", "__pycache__", "build", "*.egg-info"))
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder), str(source)]
    subprocess.run(build, check=True, stdout=subprocess.DEVNULL, timeout=180)
    return folder


def distribution() -> metadata.Distribution:
    try:
        return metadata.distribution("robot_ident")
    except metadata.PackageNotFoundError:
        pytest.fail("robot_ident is not installed in this Python; run `make test`")


def installed(suffix: str) -> Path:
    """Return the one installed file whose path ends like that."""
    files = [Path(str(file.locate())).resolve() for file in distribution().files or ()]
    found = [file for file in files if file.as_posix().endswith(f"/{suffix}")]
    assert len(found) == 1, f"{suffix}: {found}"
    return found[0]


def test_package_xml_names_an_ament_python_package(package_xml: ElementTree.Element) -> None:
    assert package_xml.tag == "package" and package_xml.get("format") == "3"
    assert package_xml.findtext("name") == "robot_ident"
    assert package_xml.findtext("export/build_type") == "ament_python"
    assert package_xml.findtext("license") == "Apache-2.0"
    maintainer = package_xml.find("maintainer")
    assert maintainer is not None and maintainer.text
    assert re.fullmatch(r"[-\w.]+@[-\w]+(\.[-\w]+)+", maintainer.get("email", "")), "colcon drops such a package.xml"
    assert re.fullmatch(r"\d+\.\d+\.\d+", package_xml.findtext("version") or "")


def test_package_xml_lists_what_the_nodes_import(package_xml: ElementTree.Element, package: Path) -> None:
    listed = {str(tag.text) for tag in package_xml if tag.tag.endswith("depend")}
    for file in (package / "nodes").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for top in {name.partition(".")[0] for name in names}:
                if top.endswith(("_msgs", "_srvs")) or top in ("rclpy", "builtin_interfaces"):
                    assert top in listed, f"{file.name} imports {top}, which package.xml does not list"


def test_versions_agree(package_xml: ElementTree.Element, checkout: Path) -> None:
    version = package_xml.findtext("version")
    assert distribution().version == version == robot_ident.__version__
    newest = re.search(r"^## (\d\S*)", (checkout / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest and newest[1] == version


def test_everything_is_installed(package: Path, checkout: Path) -> None:
    """Every module and data file of the checkout arrives; nothing that was deleted stays behind."""

    def files(folder: Path) -> set[str]:
        found = (p for p in folder.rglob("*") if p.is_file() and "__pycache__" not in p.parts)
        return {p.relative_to(folder).as_posix() for p in found}

    assert files(package) == files(checkout / "robot_ident")
    share = installed("share/robot_ident/package.xml").parent
    assert files(share / "config") == files(checkout / "config")
    assert files(share / "launch") == files(checkout / "launch")
    assert (share / "config" / "robots" / "kuka_ir361.yaml").is_file()


def test_ament_finds_the_package() -> None:
    marker = installed("share/ament_index/resource_index/packages/robot_ident")
    prefix = marker.parents[4]
    program = "from ament_index_python import get_package_share_directory as f; print(f('robot_ident'))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"AMENT_PREFIX_PATH": str(prefix)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()).resolve() == installed("share/robot_ident/package.xml").parent


def test_every_program_is_there() -> None:
    points = {point.name: point for point in distribution().entry_points if point.group == "console_scripts"}
    assert {name: point.value for name, point in points.items()} == PROGRAMS
    for name, point in points.items():
        module, _, function = point.value.partition(":")
        assert callable(getattr(importlib.import_module(module), function)), name
        assert os.access(installed(f"bin/{name}"), os.X_OK)


@pytest.mark.parametrize("node", NODES)
def test_launcher_starts_the_node_of_its_name_in_its_own_prefix(node: str, tmp_path: Path) -> None:
    """`ros2 run` starts PREFIX/lib/robot_ident/NODE, which hands its arguments to the program in PREFIX/bin."""
    launcher = installed(f"lib/robot_ident/{node}")
    assert os.access(launcher, os.X_OK)
    for layout in ("bin", "lib/robot_ident"):  # after pip install, after colcon build
        prefix = tmp_path / layout.replace("/", "_")
        for folder in ("bin", "lib/robot_ident"):
            (prefix / folder).mkdir(parents=True, exist_ok=True)
        copy = prefix / "lib" / "robot_ident" / node
        copy.write_bytes(launcher.read_bytes())
        copy.chmod(0o755)
        program = prefix / layout / f"robot_ident_{node}"
        program.write_text('#!/bin/sh\necho "$0" "$@"\n')
        program.chmod(0o755)
        done = subprocess.run([copy, "--ros-args", "a b"], cwd="/", capture_output=True, text=True, check=True)
        said, arguments = done.stdout.split(" ", 1)
        assert Path(said).resolve() == program.resolve()
        assert arguments == "--ros-args a b\n"


def test_launcher_without_its_program_says_so(tmp_path: Path) -> None:
    copy = tmp_path / "recorder"
    copy.write_bytes(installed("lib/robot_ident/recorder").read_bytes())
    copy.chmod(0o755)
    done = subprocess.run([copy], capture_output=True, text=True)
    assert done.returncode == 1
    assert "robot_ident_recorder was not found" in done.stderr


@pytest.mark.parametrize("node", NODES)
def test_a_node_without_ros_says_so_in_one_line(node: str) -> None:
    hide = "import sys; sys.modules['rclpy'] = None"
    program = f"{hide}; from robot_ident.nodes.start import {node}; sys.exit({node}())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"robot_ident_{node}: ROS 2 is not there") and "robot_ident[ros]" in line


def test_launchers_are_one_text(checkout: Path) -> None:
    launchers = [file for file in (checkout / "scripts").iterdir() if file.is_file() and file.suffix != ".py"]
    assert {file.name for file in launchers} == set(NODES)
    assert len({file.read_bytes() for file in launchers}) == 1


def test_no_ros_among_the_requirements() -> None:
    """An installed ROS 2 brings its own packages; wheels of them beside it would be chosen first."""
    requirements = distribution().requires or []
    ros = [line for line in requirements if re.match(r"ros-|rclpy|.*_msgs", line)]
    assert ros and all('extra == "ros"' in line.replace("'", '"') for line in ros)


def test_sdist_and_wheel_are_complete(built: Path, checkout: Path) -> None:
    sdist, wheel = next(built.glob("*.tar.gz")), next(built.glob("*.whl"))
    with tarfile.open(sdist) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    for name in ("package.xml", "LICENSE", "README.md", "config/robots/kuka_ir361.yaml", "test/test_packaging.py"):
        assert name in packed
    assert not [name for name in packed if name.endswith(".pyc")]
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        launchers = [info for info in archive.infolist() if "/lib/robot_ident/" in info.filename]
    assert not [name for name in names if name.startswith("test/")]
    assert {Path(info.filename).name for info in launchers} == set(NODES)
    assert all(info.external_attr >> 16 & 0o111 for info in launchers), "launchers must stay executable"
    modules = {p.relative_to(checkout).as_posix() for p in (checkout / "robot_ident").rglob("*.py")}
    assert modules <= set(names)
