"""Installs robot_ident: by pip into any Python, with or without ROS 2, and by colcon as an ament_python package."""

import os
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = "robot_ident"
HERE = Path(__file__).resolve().parent  # `colcon build --symlink-install` runs a link to this file
VERSION = ElementTree.parse(HERE / "package.xml").findtext("version")  # the one place that says it


def share(folder: str) -> list[tuple[str, list[str]]]:
    """Return the data files of a folder and of those below it, for the same place under `share/robot_ident`."""
    files = [path for path in glob(f"{folder}/**", recursive=True) if os.path.isfile(path)]
    places = sorted({os.path.dirname(path) for path in files})
    return [(f"share/{NAME}/{place}", sorted(p for p in files if os.path.dirname(p) == place)) for place in places]


setup(
    name=NAME,
    version=VERSION,
    description="Optimal excitation of robots, identification with uncertainty, and diagnosis of what the model lacks",
    long_description=(HERE / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    license="Apache-2.0",
    maintainer="robot_ident maintainers",
    maintainer_email="maintainers@robot-ident.org",
    python_requires=">=3.10",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    include_package_data=False,
    package_data={NAME: ["py.typed"], f"{NAME}.report": ["templates/*"], f"{NAME}.workbench": ["assets/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"lib/{NAME}", sorted(set(glob("scripts/*")) - set(glob("scripts/*.py")))),  # where `ros2 run` looks
        *share("config"),
        *share("launch"),
    ],
    install_requires=[
        "casadi>=3.6.7,<4",
        "clarabel>=0.9",
        "dash>=4,<5",
        "flask>=3.1",  # earlier ones don't go with the werkzeug of today
        "Jinja2>=3.1",
        "joblib>=1.4",  # results in the order in which they come
        "lz4>=4.3",
        "mcap>=1.5",  # Writer.flush
        "numpy>=1.26,<3",
        "pin>=4,<5",
        "plotly>=6",
        "psutil>=5.9",  # with it loky ends its workers; without it needs pgrep, which a bare machine lacks
        "pydantic>=2.6,<3",
        "PyYAML>=6.0.1",
        "rosbags>=0.10.9",  # its store of ROS 2 Jazzy, CompressionFormat
        "scipy>=1.11",
        "tqdm>=4.66",
        "zstandard>=0.22",
    ],
    extras_require={
        # ROS 2 Jazzy from wheels; not a requirement, since an installed ROS 2 brings its own.
        "ros": ["ros-jazzy-rclpy[fastrtps]==7.1.6", "ros-jazzy-common-interfaces==5.3.6"],
        # --cluster: the same cases on a Dask scheduler
        "cluster": ["distributed>=2024.1"],
        "test": [
            "build>=1.2",
            "distributed>=2024.1",
            "example-robot-data>=5",
            "hypothesis>=6.100",
            "import-linter>=2.12",
            "mujoco>=4; python_version >= '3.11'",
            "mypy>=1.11",
            "playwright>=1.45",
            "pytest-xdist>=3.6",
            "pytest>=9",
            "ruff>=0.9",
            "types-PyYAML",
        ],
    },
    entry_points={
        "console_scripts": [
            "robot_ident = robot_ident.cli.main:main",
            "robot_ident_trajectory_publisher = robot_ident.nodes.start:trajectory_publisher",
            "robot_ident_simulated_kuka = robot_ident.nodes.start:simulated_kuka",
            "robot_ident_simulated_clock = robot_ident.nodes.start:simulated_clock",
            "robot_ident_recorder = robot_ident.nodes.start:recorder",
            "robot_ident_estimator = robot_ident.nodes.start:estimator",
        ]
    },
)
