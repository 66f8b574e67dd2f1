"""Outlines: triangles of polygons, sections of walls, mistakes; and prisms for physics, laser and map."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from btcore_sim.errors import SimError
from btcore_sim.laser import RayCaster
from btcore_sim.map_rasteriser import overhangs, rasterise
from btcore_sim.polygons import boundary, polygon_triangles, signed_area, wall_quads
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import RobotAt, Steer

L_SHAPE = [(0.0, 0.0), (2.0, 0.0), (2.0, 0.5), (0.5, 0.5), (0.5, 2.0), (0.0, 2.0)]
COMB = [(0.0, 0.0), (5.0, 0.0), *((5 - 0.5 * k, 2.0 if k % 2 else 0.3) for k in range(11))]
STAR = [
    (radius * math.cos(k * math.pi / 5), radius * math.sin(k * math.pi / 5))
    for k, radius in zip(range(10), [2.0, 0.6] * 5, strict=True)
]
ON_A_LINE = [(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0), (0.0, 2.0)]


def load(folder: Path, *objects: dict[str, object]) -> WorldDescription:
    path = folder / "mine.json"
    path.write_text(json.dumps({"start": {"pose": [-1, -1, 0]}, "objects": objects}))
    return load_world_description(str(path))


@pytest.mark.parametrize("outline", [L_SHAPE, COMB, STAR, ON_A_LINE])
@pytest.mark.parametrize("turned", [False, True])
def test_triangles_cover_a_polygon_exactly(outline: list[tuple[float, float]], turned: bool) -> None:
    triangles = polygon_triangles(outline[::-1] if turned else outline)
    areas = [signed_area(triangle) for triangle in triangles]
    assert min(areas) > 0.0
    assert sum(areas) == pytest.approx(abs(signed_area(outline)))
    sides = boundary(triangles)
    length = sum(math.dist(*side) for side in sides)
    assert length == pytest.approx(sum(map(math.dist, outline, [*outline[1:], outline[0]])))


def test_a_closed_wall_is_a_ring_of_the_given_thickness() -> None:
    square = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]
    quads = wall_quads(square, 0.2, closed=True)
    assert len(quads) == 4
    assert sum(map(signed_area, quads)) == pytest.approx(4.2 * 3.2 - 3.8 * 2.8)
    assert len(boundary(quads)) == 8
    opened = wall_quads(square, 0.2, closed=False)
    assert sum(map(signed_area, opened)) == pytest.approx(0.2 * (4 + 3 + 4))


POLYGON = {"name": "p", "kind": "polygon", "height": 1}
WALL = {"name": "w", "kind": "wall", "height": 1}


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (
            {**POLYGON, "points": [[0, 0], [2, 2], [2, 0], [0, 2]]},
            r"'objects\[0\].points' are no outline: the sides points\[0\]–points\[1\] and",
        ),
        (
            {**POLYGON, "points": [[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]]},
            r"the sides points\[0\]–points\[1\] and points\[2\]–points\[3\] meet, but an outline must not",
        ),
        ({**POLYGON, "points": [[0, 0], [2, 0], [1, 0]]}, r"points\[0\]–points\[1\] .* meet"),
        ({**POLYGON, "points": [[0, 0], [1, 0]]}, "there are 2 points, but 3 to 200 are expected"),
        ({**POLYGON, "points": [[k, k * k] for k in range(201)]}, "there are 201 points, but 3 to 200"),
        (
            {**POLYGON, "points": [[0, 0], [1, 0], [1, 0], [0, 1]]},
            r"points\[1\] and points\[2\] are the same point: remove one",
        ),
        ({**WALL, "points": [[0, 0]]}, "there are 1 points, but 2 to 200 are expected"),
        (
            {**WALL, "points": [[0, 0], [3, 0], [0, 0.1]]},
            r"turns by more than 150° at points\[1\]: use two walls",
        ),
        (
            {**WALL, "points": [[0, 0], [1, 0], [1, 0.2], [0, 0.2]], "thickness": 0.3},
            r"points\[1\] and points\[2\] are too close together for a thickness of 0.3 m",
        ),
        ({**WALL, "points": [[0, 0], [3, 0], [3, 1], [1, 1], [1, -1]]}, "meet, but an outline must not"),
    ],
)
def test_mistake_in_outline_is_reported_with_place(tmp_path: Path, item: dict, message: str) -> None:
    with pytest.raises(SimError, match=message):
        load(tmp_path, item)


@pytest.fixture
def yard(tmp_path: Path) -> WorldDescription:
    """A turned L, a comb and a bent wall."""
    return load(
        tmp_path,
        {**POLYGON, "name": "l", "points": L_SHAPE, "position": [1, 1], "yaw": 0.4},
        {**POLYGON, "name": "comb", "points": COMB, "position": [-6, 1]},
        {**WALL, "points": [[-4, -3], [2, -3], [3, -1.5], [3, 0]], "thickness": 0.15},
    )


def test_laser_and_engine_see_the_same_prisms(yard: WorldDescription) -> None:
    world = World(yard)
    angles = np.linspace(-math.pi, math.pi, 360, endpoint=False)
    caster = RayCaster.of(yard.objects)
    for x, y in ((0.0, 0.0), (1.9, 2.4), (-3.0, 2.6), (2.5, -2.0)):
        assert yard.clearance_at(x, y) > 0.0
        ends = [(x + 20 * math.cos(angle), y + 20 * math.sin(angle), 0.5) for angle in angles]
        hits = pybullet.rayTestBatch([(x, y, 0.5)] * len(ends), ends, physicsClientId=world.client)
        engine = np.array([hit[2] * 20 if hit[0] > 0 else math.inf for hit in hits])
        assert np.isfinite(engine).any()
        assert caster.distances(x, y, 0.5, angles) == pytest.approx(engine, abs=1e-6)
        assert np.isinf(caster.distances(x, y, 1.5, angles)).all()
    assert (caster.distances(-5.75, 1.1, 0.5, angles) == 0.0).all(), "inside the comb"
    world.close()


def test_clearance_and_map_follow_a_concave_outline(yard: WorldDescription) -> None:
    outlines = [side for item in yard.objects for side in _sides(item)]
    map = rasterise(yard)
    random = np.random.default_rng(3)
    for x, y in random.uniform((-6, -3), (3, 3), (300, 2)):
        clearance = yard.clearance_at(x, y)
        # The angle that the outlines turn around a point inside is a whole turn.
        around = sum(_turn(x, y, side) for side in outlines)
        assert (clearance == 0.0) == (around > 1.0)
        if clearance == 0.0:
            assert map.occupied[map.cell(x, y)]
        elif clearance > map.resolution * 1.3:
            assert not map.occupied[map.cell(x, y)]
    assert 0.2 < yard.clearance_at(-3.0, 2.6) < 0.5, "between two teeth"


@pytest.mark.parametrize("start", [(1.2, 1.25, math.pi), (1.25, 1.4, -math.pi / 2), (-0.6, 1.0, 0.0)])
def test_the_robot_stops_at_every_side_of_a_concave_block(
    tmp_path: Path, robot_at: RobotAt, steer: Steer, start: tuple[float, float, float]
) -> None:
    """Inside the corner of the L, which its convex hull would fill, and outside."""
    (block,) = load(tmp_path, {**POLYGON, "points": L_SHAPE}).objects
    body = robot_at(block, pose=start)
    assert body.contacts.events == []
    steer(body, 4.0, (0.4, 0.0))
    assert body.contacts.collisions == 1
    assert body.world.bodies[body.contacts.events[0].body].name == "p"
    pose = body.true_pose()
    assert math.dist((pose.x, pose.y), start[:2]) < 0.8
    assert block.distance(pose.x, pose.y) > 0.2


def test_a_block_below_the_laser_is_a_keep_out_area_with_its_outline(tmp_path: Path) -> None:
    description = load(tmp_path, {**POLYGON, "points": L_SHAPE, "height": 0.06})
    covered = overhangs(description)
    area = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in covered)
    assert area == pytest.approx(1.75, rel=0.15), "not the 4 m² of the bounding rectangle"
    assert not any(x0 < 1.5 < x1 and y0 < 1.5 < y1 for x0, y0, x1, y1 in covered)
    assert any(x0 < 1.5 < x1 and y0 < 0.25 < y1 for x0, y0, x1, y1 in covered)


def _sides(item: WorldObject) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    x0, y0, _ = item.position
    return [tuple((x0 + cos * x - sin * y, y0 + sin * x + cos * y) for x, y in side) for side in item.sides()]


def _turn(x: float, y: float, side: tuple[tuple[float, float], tuple[float, float]]) -> float:
    (ax, ay), (bx, by) = ((px - x, py - y) for px, py in side)
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)
