"""Drawings: rounded shells of the robot, and the looks of furniture. They never change the simulation."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from btcore_scene import Mesh
from btcore_sim.errors import SimError
from btcore_sim.laser import RayCaster
from btcore_sim.looks import LOOKS, look_parts
from btcore_sim.scene_messages import world_meshes, world_parts
from btcore_sim.shells import Section, ball, loft, rounded_box
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import RobotAt

GREY = (128, 128, 128, 255)
HANDLE = 0.02  # m: handles may stand out


def volume(sections: tuple[Section, ...]) -> float:
    """Return the volume of a loft by the divergence theorem; it is negative if triangles face inwards."""
    points, _, triangles = loft(sections)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.einsum("nk,nk->n", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize(
    ("sections", "expected"),
    [
        (ball((2.0, 2.0, 2.0)), 4.19),
        (rounded_box((1.0, 2.0, 0.5)), 1.0),
        ((Section(0.0, 0.5, 1.0, 1.0, 2.0), Section(2.0, 0.5, 1.0, 1.0, 2.0)), 6.28),
    ],
    ids=["ball", "box", "cylinder"],
)
def test_a_loft_is_closed_and_its_triangles_and_normals_face_outwards(
    sections: tuple[Section, ...], expected: float
) -> None:
    assert volume(sections) == pytest.approx(expected, rel=0.12)
    points, normals, triangles = loft(sections)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(np.ones(len(normals)), abs=1e-6)
    corners = points[triangles]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    big = np.linalg.norm(faces, axis=1) > 1e-4
    assert (np.einsum("nk,nk->n", faces, normals[triangles[:, 0]])[big] > 0.0).all()


@pytest.mark.parametrize(("kind", "look"), [(kind, look) for kind, looks in LOOKS.items() for look in looks])
@pytest.mark.parametrize("size", [(0.5, 0.5, 1.1), (1.6, 0.5, 0.8), (0.4, 1.2, 1.9)])
def test_the_parts_of_a_look_are_within_the_objects_bounds(
    kind: str, look: str, size: tuple[float, float, float]
) -> None:
    if kind == "cylinder":
        size = (size[0], size[0], size[2])
    parts = look_parts(look, size, GREY)
    assert len(parts) >= 2
    for part in parts:
        assert min(part.size) > 0.0
        for axis in (0, 1):
            reach = abs(part.position[axis]) + part.size[axis] / 2
            assert reach <= size[axis] / 2 + HANDLE
        assert -1e-9 <= part.position[2] <= part.position[2] + part.size[2] <= size[2] * 1.02


def test_looks_change_the_drawing_and_nothing_else() -> None:
    description = load_world_description("house")
    plain = replace(description, objects=tuple(replace(item, look="") for item in description.objects))
    angles = np.linspace(-3.0, 3.0, 400)
    seen = [RayCaster.of(world.objects).distances(0.3, 0.2, 0.0945, angles) for world in (description, plain)]
    assert (seen[0] == seen[1]).all()
    worlds = [World(description), World(plain)]
    try:
        assert len(world_parts(worlds[0])) > len(world_parts(worlds[1]))
        assert world_meshes(worlds[0])
        assert not world_meshes(worlds[1])
    finally:
        for world in worlds:
            world.close()


def test_a_look_of_another_kind_of_object_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "room.json"
    path.write_text(
        '{"start": {"pose": [0, 0, 0]}, "objects": [{"kind": "box", "look": "plant", "size": [1, 1, 1],'
        ' "position": [3, 0]}]}',
        encoding="utf-8",
    )
    with pytest.raises(SimError, match=r"objects\[0\].look' is \"plant\", and \"backrest\", "):
        load_world_description(str(path))


def test_the_shells_of_tiago_are_within_its_footprint_and_height(robot_at: RobotAt) -> None:
    robot = robot_at()
    static = robot.static_scene()
    frames = {frame.child: frame for frame in robot.moving_scene().frames}
    shelled = {mesh.frame for mesh in static.meshes}
    assert shelled == {"base_link", "torso_fixed_link", "torso_lift_link", "head_1_link", "head_2_link"}
    assert shelled.isdisjoint(part.frame for part in static.parts)

    def corners(mesh: Mesh) -> np.ndarray:
        return np.frombuffer(mesh.vertices, "<f4").reshape(-1, 3)

    base = np.concatenate([corners(mesh) for mesh in static.meshes if mesh.frame == "base_link"])
    assert 0.26 < np.hypot(base[:, 0], base[:, 1]).max() < 0.275
    head = np.concatenate([corners(mesh) for mesh in static.meshes if mesh.frame == "head_2_link"])
    # In the frame of the head, y points up.
    assert 1.08 < frames["head_2_link"].position[2] + head[:, 1].max() < 1.13
