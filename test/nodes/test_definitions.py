"""Definitions of installed types: the same as those that rosbags brings, word for word of meaning and hash for hash."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402

from robot_ident.nodes.messages import _file, definition_of  # noqa: E402

STORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.mark.parametrize(
    "kind",
    [
        "sensor_msgs/msg/JointState",
        "diagnostic_msgs/msg/DiagnosticArray",
        "trajectory_msgs/msg/JointTrajectory",
        "std_msgs/msg/Float64",
        "sensor_msgs/msg/PointCloud2",
        "geometry_msgs/msg/WrenchStamped",
    ],
)
def test_installed_types(kind: str) -> None:
    text, type_hash = definition_of(kind)
    assert type_hash == STORE.hash_rihs01(kind)
    read = get_types_from_msg(text, kind)
    assert read == {name: STORE.fielddefs[name] for name in read}
    store = get_typestore(Stores.EMPTY)
    store.register(read)
    assert store.hash_rihs01(kind) == type_hash, "all inner types are there"


def test_a_package_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Constants, comments, bounded arrays and a type of the same package; no hash where no description is installed."""
    folder = tmp_path / "share" / "my_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Pair.msg").write_text(
        "# Of what # ever Foo bar\nint32 MOST=3\nForce[<=4] forces\nstd_msgs/Header header\n"
    )
    (folder / "Force.msg").write_text("float64[6] values\nstring<=10 name\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    _file.cache_clear()
    text, type_hash = definition_of("my_msgs/msg/Pair")
    read = get_types_from_msg(text, "my_msgs/msg/Pair")
    assert set(read) == {"my_msgs/msg/Pair", "my_msgs/msg/Force", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"}
    assert type_hash == ""
    (folder / "Force.msg").unlink()
    _file.cache_clear()
    assert definition_of("my_msgs/msg/Pair") == ("", "")
    assert definition_of("no_msgs/msg/Such") == ("", "")
    _file.cache_clear()
