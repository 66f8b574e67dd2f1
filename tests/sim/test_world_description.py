"""Worlds: files, errors in files, start poses, and the distances between objects."""

import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from btcore_robot.robot import Pose2D
from btcore_sim.errors import SimError
from btcore_sim.world_description import WorldDescription, WorldObject, world_names
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import MakeObject

RADIUS = 0.27
WALLS = {"wall_east", "wall_north", "wall_west", "wall_south"}


def outline(item: WorldObject) -> np.ndarray:
    """Return the object's outline on the floor as points at most 5 mm apart, shape (n, 2)."""
    x, y = item.size[0] / 2, item.size[1] / 2
    if item.kind == "cylinder":
        around = np.linspace(0.0, 2 * math.pi, math.ceil(2 * math.pi * x / 0.005))
        points = np.stack((x * np.cos(around), x * np.sin(around)), axis=1)
    else:
        corners = [(-x, -y), (x, -y), (x, y), (-x, y), (-x, -y)]
        sides = []
        for (x0, y0), (x1, y1) in itertools.pairwise(corners):
            part = np.linspace(0.0, 1.0, max(2, math.ceil(math.hypot(x1 - x0, y1 - y0) / 0.005)))[:, None]
            sides.append(np.array([[x0, y0]]) * (1 - part) + np.array([[x1, y1]]) * part)
        points = np.concatenate(sides)
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    return points @ np.array([[cos, sin], [-sin, cos]]) + np.array(item.position[:2])


def gap(first: WorldObject, second: WorldObject) -> float:
    """Return the distance (m) between two separate objects, exact to 3 mm and never too large."""
    return min(second.distance(*point) for point in outline(first)) - 0.0025


def test_every_shipped_world_loads() -> None:
    assert {"arena", "arena_boxes"} <= set(world_names())
    for name in world_names():
        assert load_world_description(name).objects


@pytest.mark.parametrize("name", ["arena", "arena_boxes"])
def test_walls_are_higher_than_the_robots_camera(name: str) -> None:
    walls = [item for item in load_world_description(name).objects if item.name in WALLS]
    assert len(walls) == 4
    assert all(wall.size[2] >= 2.2 and wall.position[2] == 0.0 for wall in walls)


@pytest.mark.parametrize(("name", "inside"), [("arena", 3.0), ("arena_boxes", 6.0)])
def test_the_walls_close_a_square(name: str, inside: float) -> None:
    description = load_world_description(name)
    rim = np.linspace(-inside, inside, 200)
    walls = [item for item in description.objects if item.name in WALLS]
    for at in rim:
        for point in ((at, inside), (at, -inside), (inside, at), (-inside, at)):
            assert min(wall.distance(*point) for wall in walls) < 1e-9
    assert description.clearance_at(0.9 * inside, 0.9 * inside) == pytest.approx(0.1 * inside, abs=0.01)


def test_every_gap_of_arena_boxes_is_wide_enough_to_back_up_blindly() -> None:
    """Laser range 1.0 + its offset 0.2 + hull 0.27 + 0.6 of backing + margin."""
    description = load_world_description("arena_boxes")
    obstacles = [item for item in description.objects if item.name not in WALLS]
    assert len(obstacles) >= 5
    gaps = {
        (obstacle.name, other.name): gap(obstacle, other)
        for obstacle in obstacles
        for other in description.objects
        if obstacle is not other
    }
    assert {pair: width for pair, width in gaps.items() if width < 2.3} == {}


def test_obstacles_of_arena_boxes_reach_the_floor_and_are_wide_enough_to_see() -> None:
    for item in load_world_description("arena_boxes").objects:
        if item.name not in WALLS:
            assert min(item.size[:2]) >= 0.3
            assert item.position[2] == 0.0
            assert item.size[2] > 0.3


@pytest.mark.parametrize("name", ["arena", "arena_boxes"])
def test_start_poses_are_clear_and_spread_over_the_world(name: str) -> None:
    description = load_world_description(name)
    poses = [description.start(np.random.default_rng(seed), RADIUS) for seed in range(300)]
    assert all(description.clearance_at(pose.x, pose.y) >= 1.0 + RADIUS for pose in poses)
    quadrants = {(pose.x > 0, pose.y > 0, pose.yaw > 0) for pose in poses}
    assert len(quadrants) == 8
    assert len({pose.x for pose in poses}) == len(poses)


def test_distance_to_a_turned_box(box: MakeObject) -> None:
    turned = box(1.0, 0.0, (2.0, 0.2, 1.0), yaw=math.pi / 2)
    assert turned.distance(0.0, 0.5) == pytest.approx(0.9)
    assert turned.distance(1.0, 2.0) == pytest.approx(1.0)
    assert turned.distance(1.0, 0.9) == 0.0


def test_the_file_of_a_world_can_set_the_start_pose(tmp_path: Path) -> None:
    description = load_world_description(write(tmp_path, start={"pose": [1, 2, 0.5]}))
    assert description.name == "mine"
    assert description.start(np.random.default_rng(0), RADIUS) == Pose2D(1.0, 2.0, 0.5)


def test_a_world_without_room_for_the_start_raises(tmp_path: Path) -> None:
    full: WorldDescription = load_world_description(
        write(tmp_path, objects=[{"kind": "box", "size": [4, 4, 1], "position": [0, 0]}])
    )
    with pytest.raises(SimError, match=r"world 'mine': no start pose with 1 m of room .* 'clearance'"):
        full.start(np.random.default_rng(0), RADIUS)


def test_an_unknown_world_raises_with_a_suggestion_and_the_list() -> None:
    with pytest.raises(SimError, match=r"no world 'arena_bokses': .*arena, .*; did you mean 'arena_boxes'\?"):
        load_world_description("arena_bokses")


def test_a_table_is_a_top_on_four_legs(tmp_path: Path) -> None:
    table = {"name": "desk", "kind": "table", "size": [1.2, 0.6, 0.7], "position": [1, 2], "yaw": math.pi / 2}
    top, *legs = load_world_description(write(tmp_path, objects=[{**table, "top": 0.05, "leg": 0.1}])).objects
    assert (top.name, top.kind, top.size) == ("desk_top", "box", (1.2, 0.6, 0.05))
    assert top.position == pytest.approx((1.0, 2.0, 0.65))
    assert [leg.name for leg in legs] == [f"desk_leg_{number}" for number in (1, 2, 3, 4)]
    assert {(round(leg.position[0], 6), round(leg.position[1], 6)) for leg in legs} == {
        (0.75, 1.45),
        (0.75, 2.55),
        (1.25, 1.45),
        (1.25, 2.55),
    }
    assert all(leg.size == pytest.approx((0.1, 0.1, 0.65)) and leg.position[2] == 0.0 for leg in legs)


def test_a_world_can_set_waypoints_keep_outs_and_its_physics_rate(tmp_path: Path) -> None:
    description = load_world_description(
        write(tmp_path, waypoints={"wp1": [1, 2]}, keepout=[[0, 0, 1, 2]], physics_rate=120)
    )
    assert (description.waypoints, description.keepout) == ({"wp1": (1.0, 2.0)}, ((0.0, 0.0, 1.0, 2.0),))
    assert description.physics_rate == 120
    bare = load_world_description(write(tmp_path))
    assert (bare.waypoints, bare.keepout, bare.physics_rate) == ({}, (), 240)


BOX = {"name": "a", "kind": "box", "size": [1, 1, 1], "position": [3, 3]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"objects": [{**BOX, "kind": "bx"}]},
            r"'objects\[0\].kind' is \"bx\", and \"box\", .* is expected; did you mean 'box'\?",
        ),
        ({"objects": [{"size": [1, 1, 1]}]}, r"'objects\[0\].kind' is missing"),
        (
            {"objects": [BOX, {**BOX, "sice": 1}]},
            r"'objects\[1\].sice' is unknown: known are kind, name, .*; did you mean 'size'\?",
        ),
        ({"objects": [BOX, BOX]}, r"'objects\[1\]' is named 'a' like another object"),
        ({"objects": [{**BOX, "color": "red"}]}, 'color\' is "red", and a text like "#c8b090" is expected'),
        ({"start": {"area": [1, 1, 0, 0]}}, r"'start.area' has \[1, 1, 0, 0\], but the form is x and y from"),
        ({"start": {}}, "'start' needs either 'area' or 'pose'"),
        ({"start": None}, "'start' is null, and an object of keys and values is expected"),
        (
            {"objects": [{**BOX, "kind": "table", "leg": 0.6}]},
            r"'objects\[0\]' has a 'top' of 0.04 m and legs of 0.6 m, which don't fit",
        ),
        ({"keepout": [[1, 0, 0, 1]]}, r"'keepout' has \[1, 0, 0, 1\], but the form is x and y from"),
        (
            {"objects": [{"kind": "polygon", "points": [[0, 0], [1, 0]], "height": 1}]},
            r"'objects\[0\].points' are no outline: ",
        ),
    ],
)
def test_error_in_world_has_its_place(tmp_path: Path, changes: dict[str, object], message: str) -> None:
    with pytest.raises(SimError, match=message) as caught:
        load_world_description(write(tmp_path, **changes))
    assert "mine.json:1: " in str(caught.value)


def test_a_file_that_is_not_json_is_reported_with_line_and_column(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text('{"objects": [,]}')
    with pytest.raises(SimError, match=r"mine.json:1:14: not valid JSON"):
        load_world_description(str(path))


def test_a_list_is_not_a_world(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text("[]")
    with pytest.raises(SimError, match="a world is a JSON object"):
        load_world_description(str(path))


def test_a_deeply_nested_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text("[" * 100_000 + "]" * 100_000)
    with pytest.raises(SimError, match="nested more than 100 levels deep"):
        load_world_description(str(path))


def test_error_in_a_file_of_the_greatest_depth_has_its_line(tmp_path: Path) -> None:
    world = tmp_path / "world.json"
    world.write_text('{"x":\n' + "[" * 99 + "1" + "]" * 99 + "}")
    with pytest.raises(SimError, match=r"world\.json:1: 'x' is unknown"):
        load_world_description(str(world))


def test_a_missing_file_raises() -> None:
    with pytest.raises(SimError, match=r"nowhere/mine\.json: no such file"):
        load_world_description("nowhere/mine.json")


def write(folder: Path, **changes: object) -> str:
    path = folder / "mine.json"
    path.write_text(json.dumps({"start": {"area": [-2, -2, 2, 2]}, "objects": [], **changes}))
    return str(path)
