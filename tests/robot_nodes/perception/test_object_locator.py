"""Coloured objects as boxes in space, compared with the pinhole model and the furniture of the house."""

import re
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from tests.robot_nodes.conftest import RecordingRobot

pytest.importorskip("pybullet")

from btcore.bundled_trees import folder
from btcore_navigation.stack import Navigation
from btcore_robot.components.lifecycle import LifecycleState
from btcore_robot.perception.colour import WOOD
from btcore_robot.perception.object_locator import BoundingBox3D, ObjectLocator, depth_to_points, detect_boxes
from btcore_robot.robot import CameraImage, CameraInfo, Phase
from btcore_robot.transforms import FrameBroadcaster, Transform, TransformTree
from btcore_scene import MovingScene
from btcore_sim.camera import CameraSettings
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

LENS = CameraInfo(160, 120, 100.0, 100.0, 79.5, 59.5, 0.1, 20.0, 10.0, "camera")
LOOKING_AHEAD = Transform((0.0, 0.0, 1.0), (-0.5, 0.5, -0.5, 0.5))
"""A camera 1 m above the floor: its z is the frame's x, its x the frame's -y, its y the frame's -z."""
BROWN = (170, 120, 60)
SLACK = 0.05
"""By how much (m) a box may reach beyond its piece of furniture."""


class Canvas:
    """Return a picture of walls with the colour of wood before a grey background."""

    def __init__(self) -> None:
        self.rgb = np.full((120, 160, 3), 120, dtype=np.uint8)
        self.depth = np.full((120, 160), np.inf, dtype=np.float32)

    def wall(self, rows: slice, columns: slice, depth: float) -> None:
        self.rgb[rows, columns] = BROWN
        self.depth[rows, columns] = depth

    def boxes(self) -> list[BoundingBox3D]:
        return detect_boxes(
            CameraImage(self.rgb, 7, "camera", self.depth), LENS, WOOD, "base_footprint", LOOKING_AHEAD
        )


@pytest.fixture
def canvas() -> Canvas:
    return Canvas()


def test_the_point_of_a_pixel_follows_the_pinhole_model() -> None:
    depth = np.full((120, 160), 2.0, dtype=np.float32)
    chosen = np.zeros((120, 160), dtype=bool)
    chosen[100, 150] = True
    assert depth_to_points(depth, LENS, chosen) == pytest.approx(np.array([[1.41, 0.81, 2.0]]))


def test_a_wall_is_a_box_without_depth_in_the_requested_frame(canvas: Canvas) -> None:
    canvas.wall(np.s_[50:70], np.s_[100:140], 2.0)
    (box,) = canvas.boxes()
    assert (box.frame, box.stamp) == ("base_footprint", 7)
    assert box.centre == pytest.approx((2.0, -0.8, 1.0), abs=1e-6)
    assert box.size == pytest.approx((0.0, 0.78, 0.38), abs=0.03)


def test_objects_behind_each_other_have_separate_boxes_the_largest_first(canvas: Canvas) -> None:
    canvas.wall(np.s_[40:80], np.s_[40:120], 4.0)
    canvas.wall(np.s_[50:90], np.s_[60:80], 2.0)
    near = [box.centre[0] for box in canvas.boxes()]
    assert near == pytest.approx([4.0, 2.0])


def test_colour_without_depth_and_small_specks_are_ignored(canvas: Canvas) -> None:
    canvas.wall(np.s_[50:70], np.s_[100:140], np.inf)
    canvas.wall(np.s_[10:13], np.s_[10:13], 2.0)
    assert canvas.boxes() == []


def test_a_camera_without_depth_gives_no_boxes(canvas: Canvas) -> None:
    canvas.wall(np.s_[50:70], np.s_[100:140], 2.0)
    assert detect_boxes(CameraImage(canvas.rgb, 0, "camera"), LENS, WOOD, "map", Transform()) == []


def test_a_locator_without_a_camera_cannot_be_configured(robot: RecordingRobot) -> None:
    locator = ObjectLocator(robot, TransformTree())
    assert not locator.configure()
    assert locator.state is LifecycleState.UNCONFIGURED


def wait(body: SimulatedRobot, seconds: float) -> None:
    body.clock.wait_until(body.clock.now() + round(seconds * 1e9), threading.Event())


@pytest.fixture
def body() -> Iterator[SimulatedRobot]:
    world = World(load_world_description("house"), seed=1)
    yield SimulatedRobot(world, camera=CameraSettings(320, 240, 10.0))
    world.close()


@pytest.fixture
def locator(body: SimulatedRobot) -> ObjectLocator:
    tree = TransformTree()
    frames = FrameBroadcaster(body, tree)
    body.schedule.add_task(FrameBroadcaster.RATE, Phase.TRANSFORMS, frames.step)
    # The robot does not move: its odometry stays at the start, which is the map's origin in the house.
    locator = ObjectLocator(body, tree, frame="odom")
    assert locator.configure()
    return locator


def test_each_box_lies_in_wooden_furniture_of_house(body: SimulatedRobot, locator: ObjectLocator) -> None:
    assert locator.activate()
    body.move_head(-1.2, -0.15)
    wait(body, 2.6)
    pieces = extents(body.world.description)
    found = set()
    for box in locator.boxes:
        low, high = (np.array(box.centre) + sign * np.array(box.size) / 2 for sign in (-1, 1))
        around = {
            name
            for name, (least, most) in pieces.items()
            if (low >= least - SLACK).all() and (high <= most + SLACK).all()
        }
        assert around, box
        found |= around
    assert {"counter_east", "table_south_east"} <= found


def test_nearest_box_has_place_and_height_of_furniture(body: SimulatedRobot, locator: ObjectLocator) -> None:
    locator.activate()
    body.move_head(-1.2, -0.15)
    wait(body, 2.6)
    counter = locator.boxes[0]
    assert counter.centre[0] - counter.size[0] / 2 == pytest.approx(2.525 - 0.65 / 2, abs=0.02)
    assert counter.centre[2] + counter.size[2] / 2 == pytest.approx(0.9, abs=0.03)


def test_boxes_are_detected_only_by_an_active_locator(body: SimulatedRobot, locator: ObjectLocator) -> None:
    body.move_head(-1.2, -0.15)
    wait(body, 2.0)
    assert locator.boxes == ()
    locator.activate()
    wait(body, 0.6)
    assert locator.boxes
    reported = locator.moving_scene().boxes
    assert [(box.position, box.size) for box in reported] == [(box.centre, box.size) for box in locator.boxes]
    assert {box.frame for box in reported} == {"odom"}
    locator.deactivate()
    wait(body, 0.6)
    assert locator.boxes == ()
    assert locator.moving_scene() == MovingScene(boxes=[])


def test_with_the_navigation_boxes_are_in_the_map_frame(body: SimulatedRobot) -> None:
    chart = rasterise(body.world.description)
    navigation = Navigation(body, chart, np.random.default_rng(1), folder())
    locator = ObjectLocator(body, navigation.transforms)
    locator.configure()
    locator.activate()
    body.move_head(-1.2, -0.15)
    wait(body, 2.6)
    counter = locator.boxes[0]
    assert counter.frame == "map"
    assert counter.centre[0] - counter.size[0] / 2 == pytest.approx(2.525 - 0.65 / 2, abs=0.1)


def extents(description: WorldDescription) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the bounds (m) of each piece of furniture; a table includes its top and its legs."""
    found: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for item in description.objects:
        name = re.sub(r"_(top|leg_\d+|back)$", "", item.name)
        x0, y0, x1, y1 = item.outline()
        low, high = (
            np.array((x0, y0, item.position[2])),
            np.array((x1, y1, item.position[2] + item.size[2])),
        )
        if name in found:
            low, high = np.minimum(low, found[name][0]), np.maximum(high, found[name][1])
        if not name.startswith("wall"):
            found[name] = low, high
    return found
