"""WorldDescription messages other than shapes and poses: camera, battery and named places."""

import numpy as np
import pytest

from btcore_sim.camera import CameraSettings
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import RobotAt, Steer

CAMERA = CameraSettings(64, 48, 10.0)


def test_a_picture_is_sent_once_and_only_if_it_was_taken(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(camera=CAMERA)
    body.static_scene()
    steer(body, 0.5, (0.0, 0.0))
    assert not body.moving_scene().pictures
    assert body._camera.newest is None

    picture = body.camera()
    reported = body.moving_scene().pictures
    assert [(picture.name, picture.size, picture.format, picture.stamp) for picture in reported] == [
        ("camera", (64, 48), "rgb8", picture.stamp)
    ]
    assert np.frombuffer(reported[0].data, np.uint8).reshape(48, 64, 3).tolist() == picture.rgb.tolist()
    assert not body.moving_scene().pictures
    body.static_scene()
    assert body.moving_scene().pictures


def test_the_camera_is_attached_to_the_head(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(camera=CAMERA)
    (camera,) = body.static_scene().cameras
    assert camera.size == (64, 48)
    assert camera.focal == (body.camera_info.fx, body.camera_info.fy)
    frames = {child: parent for child, parent, *_ in body.moving_scene().frames}
    way = [camera.frame]
    while way[-1] in frames:
        way.append(frames[way[-1]])
    assert "head_2_link" in way
    assert way[-1] == "map"
    assert len(frames) == len(body.moving_scene().frames)
    assert not robot_at().static_scene().cameras


def test_the_scene_has_the_battery_level_while_it_drains(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(battery=60.0)
    assert body.static_scene().battery == pytest.approx(60.0)
    steer(body, 10.0, (0.3, 0.0))
    reported = body.moving_scene().battery
    assert reported == body.battery().level
    assert reported < 59.0


def test_the_scene_has_the_named_places_of_the_world() -> None:
    world = World(load_world_description("house"), seed=1)
    places = {place.name: place.position for place in SimulatedRobot(world).static_scene().places}
    world.close()
    assert sorted(places) == ["recharge", "wp1", "wp2", "wp3"]
    assert places["wp1"] == (1.07, -12.38, 0.0)


def test_walls_and_polygons_are_meshes_and_doors_have_frames_of_their_own() -> None:
    world = World(load_world_description("lobby"), seed=1)
    body = SimulatedRobot(world, camera=None)
    static = body.static_scene()
    meshes = {mesh.name: mesh for mesh in static.meshes if mesh.frame == "map"}
    assert {"lobby/walls", "lobby/counter", "lobby/glass_front"} <= set(meshes)
    corners = np.frombuffer(meshes["lobby/counter"].vertices, "<f4").reshape(-1, 3)
    assert corners.min(axis=0) == pytest.approx((-2.2, 0.6, 0.0))
    assert corners.max(axis=0) == pytest.approx((-0.6, 2.2, 1.0))
    assert meshes["lobby/glass_front"].color[3] < 128, "transparent"
    parts = {part.name: part.frame for part in static.parts}
    assert parts["lobby/office_door"] == "office_door"
    (door,) = [frame for frame in body.moving_scene().frames if frame.child == "office_door"]
    assert door.position == pytest.approx((2.2, 1.7, 1.05)), "open"
    world.close()
