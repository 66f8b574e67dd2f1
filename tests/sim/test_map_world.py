"""Worlds that are made from maps: walls, start, waypoints, the navigation's map, and errors."""

import json
import math
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from btcore.cli.main import main
from btcore_robot.occupancy_map import OccupancyMap, load_map, save_map
from btcore_robot.robot import Pose2D, Waypoints
from btcore_robot.waypoint_file import save_waypoints, waypoints_path
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.laser import RayCaster
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.map_walls import WALL_HEIGHT, merge_cells
from btcore_sim.map_world import MAX_CELLS
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scene_messages import world_parts
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.visible_faces import VisibleFaces
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

RADIUS = 0.275
SIDE = 0.05


def rooms() -> NDArray[np.int8]:
    """Return a map of 8 m x 5 m: two rooms with a door, specks of noise, and unknown cells around them."""
    cells = np.full((120, 180), -1, dtype=np.int8)
    cells[10:110, 10:170] = 0
    cells[10:110, [10, 11, 90, 91, 168, 169]] = 100
    cells[[10, 11, 108, 109], 10:170] = 100
    cells[50:75, 90:92] = 0
    cells[30, 40] = cells[80, 130] = cells[81, 131] = 100
    return cells


@pytest.fixture
def map_file(tmp_path: Path) -> Path:
    path = tmp_path / "rooms.yaml"
    save_map(OccupancyMap(rooms(), SIDE, (-4.0, -2.5)), path)
    return path


def test_the_pieces_of_wall_cover_exactly_the_occupied_cells() -> None:
    random = np.random.default_rng(7)
    for _ in range(20):
        mask = random.random((30, 40)) < random.uniform(0.0, 1.0)
        covered = np.zeros(mask.shape, dtype=np.int64)
        for col, row, end_col, end_row in merge_cells(mask):
            covered[row:end_row, col:end_col] += 1
        assert (covered == mask).all()


def test_the_navigation_uses_the_users_map(map_file: Path) -> None:
    description = load_world_description(str(map_file))
    drawn, given = rasterise(description), load_map(map_file)
    assert (drawn.cells == given.cells).all()
    assert (drawn.origin, drawn.resolution) == (given.origin, given.resolution)


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
def test_walls_follow_the_rules_of_the_map_file(tmp_path: Path, mode: str, negate: bool) -> None:
    known = np.where(rooms() == -1, 0, rooms()).astype(np.uint8)[::-1]
    pixels = known if mode == "raw" else known * 2 if negate else 255 - known * 2
    image = np.where(known == 100, 100 if mode == "raw" else 255 if negate else 0, pixels).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "plan.png"), image)
    (tmp_path / "plan.yaml").write_text(
        f"image: plan.png\nresolution: {SIDE}\norigin: [0, 0, 0]\nmode: {mode}\nnegate: {int(negate)}\n"
    )
    walls = load_world_description(str(tmp_path / "plan.yaml")).walls
    assert walls is not None
    area = np.prod(walls.rectangles[:, 2:] - walls.rectangles[:, :2], axis=1).sum()
    assert area == pytest.approx(np.count_nonzero(rooms() == 100) * SIDE**2)


def test_laser_physics_and_drawings_show_the_same_walls(map_file: Path) -> None:
    description = load_world_description(str(map_file))
    caster = RayCaster.of((), description.walls)
    x, y = -4.0 + 20.5 * SIDE, -2.5 + 90.5 * SIDE
    found = caster.distances(x, y, 0.1, np.array([math.pi / 2, math.pi, 1.5 * math.pi]))
    assert found == pytest.approx(np.array([108 - 90.5, 20.5 - 12, 90.5 - 12]) * SIDE)
    world = World(description)
    robot = SimulatedRobot(world, camera=None)
    boxes = description.walls.rectangles if description.walls is not None else []
    assert len(world_parts(world)) == 1 + len(boxes)
    tops = VisibleFaces(world, robot.physics_body).now()[: 6 * len(boxes), :, 2]
    assert tops.max() == WALL_HEIGHT
    world.close()


def test_driving_into_a_wall_is_a_collision(map_file: Path) -> None:
    save_waypoints(Waypoints({"start": Pose2D(2.0, 0.0, 0.0)}), waypoints_path(map_file))
    world = World(load_world_description(str(map_file)))
    robot = SimulatedRobot(world, camera=None)
    for tick in range(1, 60):
        robot.drive(0.6, 0.0)
        world.wait_until(tick * 100_000_000, threading.Event())
    assert robot.contacts.collisions >= 1
    assert robot.true_pose().x < 4.45
    world.close()


def test_random_places_are_free_connected_and_apart(map_file: Path) -> None:
    starts = set()
    for seed in range(5):
        description = load_world_description(str(map_file), seed=seed, radius=RADIUS)
        again = load_world_description(str(map_file), seed=seed, radius=RADIUS)
        assert (description.pose, description.waypoints) == (again.pose, again.waypoints)
        assert description.pose is not None
        starts.add((description.pose.x, description.pose.y))
        places = list(description.waypoints.values())
        assert list(description.waypoints) == ["start", "recharge", "wp1", "wp2", "wp3"]
        assert min(math.dist(a, b) for a in places for b in places if a is not b) >= 1.0
        assert ClearanceMap.of(description).connected(places, RADIUS + 0.05)
    assert len(starts) == 5


def test_waypoints_come_from_file_beside_map_or_from_option(map_file: Path, tmp_path: Path) -> None:
    beside = Waypoints({"start": Pose2D(0.0, 0.5, 1.0), "desk": Pose2D(1.0, 0.0, 0.5)})
    save_waypoints(beside, waypoints_path(map_file))
    description = load_world_description(str(map_file))
    assert description.pose == beside.places["start"]
    assert description.waypoint_poses().places == beside.places
    other = Waypoints({"shelf": Pose2D(-3.0, 1.0, 0.0)})
    save_waypoints(other, tmp_path / "other.yaml")
    assert list(load_world_description(str(map_file), waypoints=tmp_path / "other.yaml").waypoints) == [
        "shelf"
    ]
    assert list(load_world_description("house", waypoints=tmp_path / "other.yaml").waypoints) == ["shelf"]


def test_the_start_is_in_the_region_of_the_waypoints(map_file: Path) -> None:
    cells = rooms()
    cells[50:75, 90:92] = 100  # the door is closed
    save_map(OccupancyMap(cells, SIDE, (-4.0, -2.5)), map_file)
    save_waypoints(Waypoints({"wp1": Pose2D(3.0, 0.0, 0.0)}), waypoints_path(map_file))
    for seed in range(5):
        start = load_world_description(str(map_file), seed=seed, radius=RADIUS).pose
        assert start is not None
        assert start.x > 0.6


def test_a_map_of_four_million_cells_with_noise_loads(tmp_path: Path) -> None:
    cells = np.zeros((2000, 2000), dtype=np.int8)
    cells[::100] = cells[:, ::100] = 100
    cells[50::100] = cells[:, 50::100] = 0
    cells[np.random.default_rng(3).random(cells.shape) < 0.002] = 100
    save_map(OccupancyMap(cells, SIDE, (0.0, 0.0)), tmp_path / "large.yaml")
    description = load_world_description(str(tmp_path / "large.yaml"))
    assert description.walls is not None
    assert len(description.walls.meshes()) >= 2
    world = World(description)
    for x0, y0, x1, y1 in description.walls.rectangles[:: len(description.walls.rectangles) // 20]:
        middle = (y0 + y1) / 2
        ends = [x0 - SIDE / 2, middle, 0.5], [x1, middle, 0.5]
        ray = pybullet.rayTest(*ends, physicsClientId=world.client)
        assert ray[0][0] >= 0
    world.close()


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (np.full((50, 50), 100, dtype=np.int8), "has no free floor with room for a robot of 0.275 m radius"),
        (np.full((50, 50), -1, dtype=np.int8), "has no free floor"),
        (np.zeros((MAX_CELLS // 4000 + 1, 4000), dtype=np.int8), "a world can have at most 16,000,000"),
    ],
    ids=["wall", "unknown", "too large"],
)
def test_a_map_that_is_no_world_is_an_error(tmp_path: Path, cells: NDArray[np.int8], message: str) -> None:
    save_map(OccupancyMap(cells, SIDE, (0.0, 0.0)), tmp_path / "map.yaml")
    with pytest.raises(SimError, match=message):
        load_world_description(str(tmp_path / "map.yaml"), radius=RADIUS)


def test_a_run_in_a_map_reports_its_waypoints_and_errors(map_file: Path, tmp_path: Path) -> None:
    save_waypoints(
        Waypoints({"start": Pose2D(0.0, 0.0, 0.0), "wp1": Pose2D(-0.4, 0.0, 0.0)}), waypoints_path(map_file)
    )
    tree = tmp_path / "go.xml"
    tree.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="Go"><Sequence><GetWaypoint waypoint="{at}"/>'
        '<Move goal="{at}"/></Sequence></BehaviorTree></root>'
    )
    arguments = ["run", str(tree), "--fast", "--camera", "off", "--json", "--duration", "20"]
    result = CliRunner().invoke(main, [*arguments, "--world", str(map_file)])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout.splitlines()[-1])["robot"]["waypoints_visited"] == ["wp1"]
    missing = CliRunner().invoke(main, [*arguments, "--world", str(tmp_path / "no.yaml")])
    assert missing.exit_code == 2
    assert "no.yaml" in missing.stderr
