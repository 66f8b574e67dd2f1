"""Mesh files of a URDF: they are drawn, and a file that cannot be drawn is reported."""

import logging
import re
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore_sim.errors import SimError
from btcore_sim.mesh_files import MAX_TRIANGLES, read_triangles
from btcore_sim.robot_description import load_robot_description

CORNERS = ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0))
FACES = ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2))
TETRAHEDRON = np.array(CORNERS)[np.array(FACES)]


def binary_stl(triangles: np.ndarray) -> bytes:
    rows = (struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    return bytes(80) + struct.pack("<I", len(triangles)) + b"".join(rows)


def text_stl() -> bytes:
    lines = ["solid tetrahedron"]
    for triangle in TETRAHEDRON:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid"]).encode()


def obj(first: int) -> bytes:
    points = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    faces = ["f " + " ".join(f"{corner + first}/1/1" for corner in face) for face in FACES]
    return "\n".join(["# a comment", *points, *faces]).encode()


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("mesh.stl", binary_stl(TETRAHEDRON)),
        ("mesh.STL", text_stl()),
        ("mesh.obj", obj(1)),
        ("mesh.obj", obj(-4)),
    ],
)
def test_the_triangles_of_each_format_are_read(tmp_path: Path, name: str, data: bytes) -> None:
    (tmp_path / name).write_bytes(data)
    assert read_triangles(tmp_path / name) == pytest.approx(TETRAHEDRON)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("mesh.dae", b"<COLLADA/>", "meshes of this format are not drawn: use STL or OBJ"),
        ("mesh.stl", b"solid\nvertex 1 2\n", "not a valid stl file"),
        ("mesh.stl", b"\xff" * 200, "not a valid stl file"),
        ("mesh.obj", b"v 0 0 0\nf 1 2 3\n", "not a valid obj file"),
        ("mesh.obj", b"v 0 0 0\nf -2 1 1\n", "not a valid obj file"),
        ("mesh.obj", b"v nan 0 0\nf 1 1 1\n", "not finite"),
        ("mesh.obj", b"", "no triangles"),
        ("mesh.obj", b"v 0 0 0\n" + b"f 1 1 1\n" * (MAX_TRIANGLES + 1), "20001 triangles, but only"),
    ],
)
def test_mesh_that_cannot_be_drawn_is_error(tmp_path: Path, name: str, data: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SimError, match=re.compile(message, re.IGNORECASE)):
        read_triangles(tmp_path / name)


def test_meshes_of_urdf_are_drawn_in_place_and_size(tmp_path: Path, robot_at: Any, caplog: Any) -> None:
    tiago = load_robot_description()
    (tmp_path / "hat.stl").write_bytes(binary_stl(TETRAHEDRON))
    text = tiago.urdf.read_text(encoding="utf-8")
    hat = (
        '<visual><origin xyz="0.1 0 0.5"/><geometry><mesh filename="hat.stl" scale="0.1 0.1 0.1"/>'
        "</geometry></visual>"
    )
    place = text.index("<visual>", text.index('<link name="wheel_left_link">'))
    (tmp_path / "hat.urdf").write_text(text[:place] + hat + text[place:], encoding="utf-8")
    robot = robot_at(description=replace(tiago, urdf=tmp_path / "hat.urdf", shells=()))
    (mesh,) = robot.static_scene().meshes
    assert mesh.frame == "wheel_left_link"
    corners = np.frombuffer(mesh.vertices, "<f4").reshape(-1, 3, 3)
    assert corners == pytest.approx(0.1 * TETRAHEDRON + np.array((0.1, 0.0, 0.5)), abs=1e-6)
    (tmp_path / "hat.stl").write_bytes(b"")
    with caplog.at_level(logging.WARNING):
        assert not robot.static_scene().meshes
    assert "not a valid STL file" in caplog.text or "no triangles" in caplog.text
