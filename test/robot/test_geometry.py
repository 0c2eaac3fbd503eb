"""Bodies of links: convex pieces hold the mesh, packages are found, bad meshes are named."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from robot_ident.errors import InputError
from robot_ident.robot import load_robot
from robot_ident.robot.geometry import MeshMissing, convex_pieces
from robot_ident.robot.urdf import find_resource
from robot_ident.signals.motion import Array

YAML = "schema: robot_ident/robot/1\nname: arm\nurdf: arm.urdf\n"


def box_triangles(low: tuple[float, ...], high: tuple[float, ...]) -> Array:
    """Return the twelve triangles of a box, outward."""
    x, y, z = np.array([low, high]).T
    quads = [
        [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
        [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
        [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
        [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)],
        [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
        [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
    ]
    corners = [[(x[i], y[j], z[k]) for i, j, k in quad] for quad in quads]
    return np.array([[c[0], c[k], c[k + 1]] for c in corners for k in (1, 2)])


def inside(points: Array, piece: Array) -> Array:
    """Return which points lie in the convex hull of a piece."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(piece)
    return np.asarray(np.all(points @ hull.equations[:, :3].T + hull.equations[:, 3] <= 1e-9, axis=1))


def test_pieces_hold_an_angle_and_leave_its_gap_free() -> None:
    """A long arm and a short one at a right angle: the hull would fill the corner between them."""
    parts = [((0.0, 0.0, 0.0), (1.0, 0.1, 0.1)), ((0.0, 0.0, 0.1), (0.1, 0.1, 0.8))]
    pieces = convex_pieces(np.concatenate([box_triangles(*part) for part in parts]))
    assert len(pieces) > 1
    rng = np.random.default_rng(0)
    for low, high in parts:
        points = rng.uniform(low, high, (500, 3))
        assert np.all(np.any([inside(points, piece) for piece in pieces], axis=0))
    gap = np.array([[0.7, 0.05, 0.3], [0.4, 0.05, 0.5]])
    assert not np.any([inside(gap, piece) for piece in pieces])


def test_a_box_stays_one_piece_and_a_plane_is_refused() -> None:
    triangles = box_triangles((0.0, 0.0, 0.0), (1.0, 0.2, 0.3))
    assert len(convex_pieces(triangles)) == 1
    with pytest.raises(ValueError, match="flat|volume"):
        convex_pieces(triangles[:2])


def test_pieces_hold_the_meshes_of_a_real_arm(robots_folder: Path) -> None:
    robot = load_robot(robots_folder / "ur_description/urdf/ur10_robot.urdf")
    assert robot.geometry is not None
    shapes = robot.geometry.shapes
    assert {body.link for body in shapes.bodies} >= {"upper_arm_link", "forearm_link", "wrist_3_link"}
    joints = [(shapes.bodies[i].joint, shapes.bodies[j].joint) for i, j in shapes.pairs]
    assert all(b - a > 1 for a, b in joints), "links that share a joint are not looked at"
    again = pickle.loads(pickle.dumps(robot))
    assert again.geometry.shapes.pairs == shapes.pairs


def test_files_in_packages_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = tmp_path / "share" / "arm_description" / "meshes" / "link.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_text("solid", encoding="utf-8")
    near, far = mesh.parent.parent / "urdf", tmp_path / "elsewhere"
    for folder in (near, far):
        folder.mkdir()
    name = "package://arm_description/meshes/link.stl"
    assert find_resource(name, near) == mesh.resolve()
    assert find_resource("../meshes/link.stl", near) is not None
    assert find_resource(f"file://{mesh}", far) == mesh
    assert find_resource(name, far) is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    assert find_resource(name, far) == mesh


def arm(folder: Path, geometry: str, extra: str = "") -> Path:
    """Write a robot of three links with the given geometry on the last one; return its YAML."""
    links = "".join(f'<link name="{name}"/>' for name in ("base", "upper"))
    solid = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    urdf = f"""<robot name="arm">{links}<link name="floor">{solid}</link>
      <link name="hand"><collision><geometry>{geometry}</geometry></collision></link>
      <joint name="bolt" type="fixed"><parent link="base"/><child link="floor"/></joint>
      <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
        <origin xyz="0 0 0.1"/><limit lower="-2" upper="2" velocity="1" effort="0"/></joint>
      <joint name="b" type="revolute"><parent link="upper"/><child link="hand"/><axis xyz="0 1 0"/>
        <origin xyz="0 0 0.5"/><limit lower="-2" upper="2" velocity="1" effort="0"/></joint></robot>"""
    (folder / "arm.urdf").write_text(urdf, encoding="utf-8")
    (folder / "arm.yaml").write_text(YAML + extra, encoding="utf-8")
    return folder / "arm.yaml"


def test_missing_and_broken_meshes_are_named(tmp_path: Path) -> None:
    mesh = '<mesh filename="hand.stl"/>'
    missing = load_robot(arm(tmp_path, mesh))
    with pytest.raises(MeshMissing, match=r"hand\.stl"):
        _ = missing.geometry.shapes
    (tmp_path / "hand.stl").write_text("no mesh at all", encoding="utf-8")
    broken = load_robot(arm(tmp_path, mesh))
    with pytest.raises(InputError, match=r"hand\.stl"):
        _ = broken.geometry.shapes


@pytest.mark.parametrize("odd", [np.nan, np.inf, 1e30])
def test_a_mesh_with_corners_that_are_no_places_is_named(odd: float, tmp_path: Path) -> None:
    triangles = box_triangles((0.0, 0.0, 0.0), (1.0, 0.2, 0.3))
    triangles[3, 1, 2] = odd
    record = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    record["corners"] = triangles
    (tmp_path / "hand.stl").write_bytes(bytes(80) + np.uint32(len(record)).tobytes() + record.tobytes())
    robot = load_robot(arm(tmp_path, '<mesh filename="hand.stl"/>'))
    with pytest.raises(InputError, match=r"hand\.stl: a mesh with corners that are no places"):
        _ = robot.geometry.shapes


def test_pairs_that_may_touch(tmp_path: Path) -> None:
    sphere = '<sphere radius="0.05"/>'
    assert len(load_robot(arm(tmp_path, sphere)).geometry.shapes.pairs) == 1
    (tmp_path / "arm.srdf").write_text(
        '<robot name="arm"><disable_collisions link1="hand" link2="floor" reason="Never"/></robot>', encoding="utf-8"
    )
    for told in ("self_collision: {srdf: arm.srdf}", "self_collision: {ignore: [[floor, hand]]}"):
        assert load_robot(arm(tmp_path, sphere, told)).geometry.shapes.pairs == ()
    assert load_robot(arm(tmp_path, sphere, "self_collision: {check: false}")).geometry is None
    lost = load_robot(
        arm(tmp_path, sphere, "self_collision: {srdf: lost.srdf}")
    )  # a model file's robot may be anywhere
    with pytest.raises(InputError, match=r"lost\.srdf"):
        _ = lost.geometry.shapes
    with pytest.raises(InputError, match="'hend'.*did you mean 'hand'"):
        _ = load_robot(arm(tmp_path, sphere, "self_collision: {ignore: [[floor, hend]]}")).geometry.shapes
    always = load_robot(arm(tmp_path, '<sphere radius="2"/>')).geometry.shapes
    assert always.pairs == ()
    assert "floor and hand" in always.notes[0]


def test_a_mesh_is_found_from_wherever_one_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import struct

    triangles = box_triangles((-0.1, -0.1, 0.0), (0.1, 0.1, 0.3))
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    arm(tmp_path, '<mesh filename="meshes/hand.stl" scale="1 1 2"/>')
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "hand.stl").write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + facets)
    monkeypatch.chdir(tmp_path.parent)
    shapes = load_robot(Path(tmp_path.name) / "arm.yaml").geometry.shapes
    (hand,) = [body for body in shapes.bodies if body.link == "hand"]
    assert hand.points.max(axis=0) == pytest.approx([0.1, 0.1, 0.6], abs=1e-6)
