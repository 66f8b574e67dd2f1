"""The scene of a robot from above."""

import math
import struct

import pytest

from btcore_monitor.plan_view import PlanView
from btcore_scene import (
    UPRIGHT,
    Box,
    Cylinder,
    Frame,
    Laser,
    Mesh,
    MovingScene,
    Place,
    Poses,
    Scan,
    StaticScene,
    float32,
)

QUARTER = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
BASE = Box(frame="base", size=(2.0, 1.0, 0.5), position=(0.0, 0.0, 0.25), color=(1, 2, 3, 255))
FLOOR = Box(frame="map", size=(8.0, 8.0, 0.1), position=(0.0, 0.0, -0.05))


def view(*frames: Frame) -> PlanView:
    plan = PlanView(
        StaticScene(
            parts=[BASE, FLOOR],
            laser=Laser(frame="laser", angle_min=0.0, angle_increment=math.pi / 2, range_max=10.0),
            places=[Place(name="dock", position=(1.0, 2.0, 0.0))],
        )
    )
    plan.take_moving(MovingScene(frames=[Frame("base", "map", (3.0, 1.0, 0.0), QUARTER), *frames]))
    return plan


def corners(flat: list[float]) -> set[tuple[float, float]]:
    return set(zip(flat[::2], flat[1::2], strict=True))


def test_bodies_are_turned_and_the_highest_is_the_last() -> None:
    scene = view().data()
    assert scene is not None
    (_, floor), (color, base) = scene["bodies"]
    assert corners(floor) == {(x, y) for x in (-4.0, 4.0) for y in (-4.0, 4.0)}
    assert color == (1, 2, 3, 255)
    assert corners(base) == {(x, y) for x in (2.5, 3.5) for y in (0.0, 2.0)}
    assert scene["places"] == [("dock", 1.0, 2.0)]


def test_echoes_follow_the_frames_of_the_laser() -> None:
    plan = view(Frame("laser", "base", (1.0, 0.0, 0.3), UPRIGHT))
    plan.take_moving(MovingScene(scan=Scan(ranges=float32([2.0, math.inf, 10.0, 1.0]))))
    scene = plan.data()
    assert scene is not None
    assert scene["scan"] == pytest.approx([3.0, 4.0, 4.0, 2.0])


def test_poses_are_replaced_and_removed() -> None:
    plan = view()
    row = struct.pack("<3f", 1.0, 0.0, 0.0)
    plan.take_moving(MovingScene(poses=[Poses(name="goal", kind="goal", frame="base", rows=row)]))
    scene = plan.data()
    assert scene is not None
    [(kind, pose)] = scene["poses"]
    assert (kind, pose) == ("goal", pytest.approx([3.0, 2.0, math.pi / 2], abs=1e-3))
    plan.take_moving(MovingScene(poses=[Poses(name="goal", kind="goal", rows=b"")]))
    assert plan.data()["poses"] == []  # type: ignore[index]


def test_a_long_path_and_frames_in_a_circle() -> None:
    plan = view(Frame("a", "b", (1.0, 0.0, 0.0), UPRIGHT), Frame("b", "a", (1.0, 0.0, 0.0), UPRIGHT))
    rows = struct.pack("<3f", 1.0, 2.0, 0.0) * 5_000
    plan.take_moving(MovingScene(poses=[Poses(name="path", kind="path", frame="a", rows=rows)]))
    scene = plan.data()
    assert scene is not None
    assert 0 < len(scene["poses"][0][1]) <= 1_200


def test_meshes_and_cylinders_have_outlines() -> None:
    inner = float32([0, 0, 0, 2, 0, 1, 2, 2, 0, 0, 2, 0, 1, 1, 3])
    mesh = Mesh(vertices=inner, normals=inner, triangles=b"")
    round_part = Cylinder(radius=1.0, length=0.1, position=(5.0, 5.0, 0.0))
    scene = PlanView(StaticScene(parts=[round_part], meshes=[mesh])).data()
    assert scene is not None
    (_, ring), (_, square) = scene["bodies"]
    assert corners(square) == {(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)}
    assert all(math.dist(corner, (5, 5)) == pytest.approx(1.0, abs=2e-3) for corner in corners(ring))


def test_a_robot_without_bodies_has_no_scene() -> None:
    assert PlanView(StaticScene()).data() is None
